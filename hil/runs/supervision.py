"""The supervision of a run's processes: faults that the script has for them, deaths, and memory.

A child that ends early is reported within 100 ms, and the run continues for half a second so that the
reaction of the others is logged.
"""

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from hil.faults.processes import ProcessFaults
from hil.processes.child import Child, Start
from hil.roster import again_name, instants, members
from hil.runs.job import Outcome, Progress
from hil.scenario.scenario import Scenario
from hil.timing.clock import NS_PER_S, OPERATOR_PERIOD_S
from hil.timing.memory import SAMPLE_S, SETTLING_SHARE, MemoryWatch
from hil.timing.pacemaker import Plan, Takes

BASELINE = "baseline"
"""Name of the bare loop, which ends before a run whose time is held."""
TURN_TAKERS = members()
"""The processes that end when no more turns are given; the one that gives them ends only when asked to."""
PERIODS_A_LOOK = 10
"""Operator's periods between two checks of the processes."""
REACTION_S = 0.5
"""Time for which the surviving nodes are recorded after a node has died."""
END_SLACK_S = 0.1
"""A loop may complete its ticks and end by this time before the operator's last period."""


def plan_of(scenario: Scenario, t0_ns: int) -> Plan:
    """The turns of the scenario's nodes, without the intervals in which it pauses, kills or restarts them.

    The turns of one instant are due one after another, in equal parts of the time until the next instant.
    """
    faults = ProcessFaults(scenario.faults)
    period_s, ticks = scenario.period_s, scenario.ticks
    period_ns = round(period_s * NS_PER_S)
    restarted = {
        process: (round(at_s / period_s), round(start_s / period_s))
        for at_s, process, start_s in faults.restarts()
    }
    takes = []
    for begin_ns, end_ns, nodes in instants(period_ns):
        for place, node in enumerate(nodes):
            due_ns = begin_ns + place * (end_ns - begin_ns) // len(nodes)
            absent = faults.absences(node.name, period_s, ticks)
            if node.name in restarted:
                ends_at, starts_at = restarted[node.name]
                again = [(0, starts_at), *absent]
                takes.append(Takes(again_name(node.name), begin_ns, due_ns, again))
                absent = [*absent, (ends_at, ticks)]
            takes.append(Takes(node.name, begin_ns, due_ns, absent))
    return Plan(t0_ns, period_ns, ticks, takes)


@dataclass
class Supervision:
    """Called in each of the operator's periods.

    `watched`: the processes whose end ends the run. `pauses`: whether to stop and continue the processes that
    the script pauses; where a pacemaker gives the turns they have none. `is_out_of_turns`: whether the nodes
    have ended, or are about to, because no more turns are given.
    """

    scenario: Scenario
    watched: Mapping[str, Child]
    outcome: Outcome
    progress: Progress
    pauses: bool
    is_out_of_turns: Callable[[], bool]
    t0_ns: int
    dead: set[str] = field(default_factory=set, init=False)
    next_look: int = field(default=0, init=False)
    next_sample_s: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self.periods = self.last_period = round(self.scenario.duration_s / OPERATOR_PERIOD_S)
        self.scripted = ProcessFaults(self.scenario.faults)
        self.signals, self.restarts = self.scripted.signals(), self.scripted.restarts()
        if not self.pauses:
            self.signals = [one for one in self.signals if one.number == signal.SIGKILL]
        self.memory = MemoryWatch({name: child.pid for name, child in self.watched.items()})

    def act(self, t_s: float) -> None:
        """Send the signals that are due, and start the processes that replace killed ones."""
        while self.signals and self.signals[0].at_s <= t_s:
            self.watched[self.signals[0].process].signal(self.signals[0].number)
            del self.signals[0]
        while self.restarts and self.restarts[0].at_s <= t_s:
            first_tick = round(self.restarts[0].start_s / self.scenario.period_s)
            self.watched[again_name(self.restarts[0].process)].start(Start(self.t0_ns, first_tick))
            del self.restarts[0]

    def attend(self, period: int) -> bool:
        """Check the processes when it is time; returns whether the run is to end with this period."""
        if period >= min(self.next_look, self.last_period):
            self.next_look = period + PERIODS_A_LOOK
            self.look(period)
        return period >= self.last_period

    def look(self, period: int) -> None:
        """Check the processes and sample their memory."""
        t_s = period * OPERATOR_PERIOD_S
        for name, child in self.watched.items():
            if name in self.dead or not child.ended:
                continue
            takes_turns = name in TURN_TAKERS
            if child.succeeded and (name == BASELINE or (takes_turns and self.is_out_of_turns())):
                continue
            self.dead.add(name)
            its_last_ticks = child.succeeded and t_s > self.scenario.duration_s - END_SLACK_S
            if its_last_ticks or self.scripted.kills(name, by_s=t_s):
                continue
            self.outcome.reasons.append(f"{child.how_it_ended()} at {t_s:.2f} s{child.why()}")
            self.last_period = min(self.last_period, period + round(REACTION_S / OPERATOR_PERIOD_S))
        self.progress(period / self.periods, "running")
        if t_s >= self.next_sample_s:
            self.next_sample_s += SAMPLE_S
            self.memory.sample()

    def note_memory(self) -> None:
        """Write the growth of memory to the outcome."""
        self.outcome.memory_growth_mb = self.memory.growth_mb()
        self.outcome.memory_watched_s = (1.0 - SETTLING_SHARE) * self.scenario.duration_s
