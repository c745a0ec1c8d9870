"""Lockstep: all nodes in one process, in exactly the order of real time, as fast as possible.

At t_k the plant publishes and advances under the frames that arrived before t_k; the operator sends. At
t_k + T/2 the firmware ticks on the frames that have arrived; its torque acts from t_{k+1}. The nodes, their
frames and the codec between them are those of real time.
"""

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import Any

from hil.bus.in_process import IdealBus
from hil.faults.fault import Fault, of_a_node
from hil.faults.line import FaultyBus
from hil.faults.processes import ProcessFaults, Turns, in_turns
from hil.nodes.runner import Making, Pace
from hil.record.new_file import append_line
from hil.roster import FIRMWARE, OPERATOR, PLANT, ROSTER, Node, instants, names
from hil.runs.job import Job
from hil.runs.modelled_bus import BusAsModelled
from hil.runs.rows import Collected, FrameRows
from hil.timing.clock import NS_PER_S, NS_PER_US
from hil.timing.loop import UNTIMED, LoopTiming

BENCH = "bench"
"""Name, among those of the nodes, under which faults of processes and of the modelled bus are counted."""


class Lockstep:
    """The nodes of the roster on their bus, and the order in which they act in a tick."""

    def __init__(self, job: Job, stack: ExitStack) -> None:
        """`stack` closes the nodes."""
        scenario, seed = job.scenario, job.seed
        self.faults: dict[str, list[Fault]] = {name: of_a_node(scenario.faults) for name in (*names(), BENCH)}
        self.rows, self.frames = Collected(job.kept), FrameRows(job.kept is None)
        self.bus: IdealBus | BusAsModelled = IdealBus()
        if scenario.bitrate is not None:
            self.bus = BusAsModelled(scenario.bitrate, self.rows, self.faults[BENCH])
        say: Callable[[str], object] = str
        if job.folder is not None:  # as of the errors of the firmware's process in real time
            say = partial(append_line, job.folder / "firmware.log")
        pace = Pace(scenario.period_s, scenario.duration_s, is_timed=False)
        self.joined = {name: self.bus.join(name) for name in names()}
        self.lines: dict[str, FaultyBus] = {}
        runners: dict[str, Any] = {}
        self.turns: dict[str, Any] = {}
        """The nodes by name, in turns if clock or process have a fault."""
        for node in ROSTER:
            name, faults = node.name, self.faults[node.name]
            on_line = [fault for fault in faults if not isinstance(fault, self.bus.breaks)]
            line = FaultyBus(self.joined[name], name, on_line, seed, pace.period_s)
            made = Making(scenario, seed, pace, line, faults, self.rows, job.firmware, say)
            self.lines[name], runners[name] = line, node.makes.make(made)
            self.turns[name] = runners[name]
            if node.is_process:
                self.turns[name] = in_turns(runners[name], name, faults, pace.period_s, seed)
            stack.callback(self.turns[name].close)
        self.plant, self.operator, self.firmware = runners[PLANT], runners[OPERATOR], runners[FIRMWARE]
        stack.callback(self.bus.close)
        self.processes = ProcessFaults(self.faults[BENCH])
        self._period_s, self._period_ns = scenario.period_s, round(scenario.period_s * NS_PER_S)
        self._instants = instants(self._period_ns)

    def tick(self, tick: int) -> None:
        """Run one tick: each node at its instant, and the bus in between."""
        self._step(ROSTER[0], tick)
        self.tick_after_first(tick)

    def tick_after_first(self, tick: int) -> None:
        """Run a tick of all nodes but the first, and let the bus reach the next tick."""
        t_ns = tick * self._period_ns
        for begin_ns, end_ns, nodes in self._instants:
            for node in nodes:
                if node is not ROSTER[0]:
                    self._step(node, tick)
            for logged_ns, frames in self.bus.pass_time(t_ns + begin_ns, t_ns + end_ns):
                self.frames.append(logged_ns // NS_PER_US, frames)

    def ticks_in(self, name: str, slot: int) -> Iterable[int]:
        """The ticks that a node's process runs in a slot of the bench, for a caller that runs them itself."""
        if not self.processes.takes_turn(name, slot * self._period_s):
            return ()
        turns = self.turns[name]
        return turns.ticks_in(slot) if isinstance(turns, Turns) else (slot,)

    def _step(self, node: Node, tick: int) -> None:
        """Run a node's step in this tick, and record it."""
        name, stepped, t_s = node.name, self.turns[node.name], tick * self._period_s
        if not node.is_process:
            if stepped.due_tick <= tick:
                self.lines[name].move_to(t_s)
                stepped.step(tick)
        elif self.processes.takes_turn(name, t_s):
            self.lines[name].move_to(t_s)
            started_ns = time.perf_counter_ns()
            stepped.step(tick)
            work_us = (time.perf_counter_ns() - started_ns) * 1e-3
            stepped.record(tick, UNTIMED if name == PLANT else LoopTiming(0, 0.0, work_us, 0))
