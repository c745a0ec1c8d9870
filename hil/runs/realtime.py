"""A run in real time: starts a process for each node on a bus, and watches them to their end.

This process acts as the operator at 100 Hz and supervises the other processes in between. At the
end all are stopped in order, and the run folder is completed as after any run.

On a bus made for the run alone, time is held while a node is late (`hil.timing.pacemaker`). On any other bus,
and on request, time is strict: a late node misses periods.
"""

import gc
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from firmware_py.interface.addresses import bus_id
from firmware_py.shell.parameters import addresses_from
from hil.bus import Bus, BusCounters, ProvidedBus, join, join_in_turns, provide, shared
from hil.bus.addressed import addressed
from hil.bus.hub_socket import TurnSocket
from hil.faults.fault import FAULTS_ACTED, effects_of, of_a_node
from hil.faults.line import FaultyBus
from hil.faults.on_process import ProcessFault
from hil.faults.processes import ProcessFaults
from hil.nodes.operator.runner import OperatorRunner
from hil.nodes.runner import Making, Pace, traces_in
from hil.processes.child import Child, ChildError, Start, has_stopped, is_busy
from hil.record import run_folder
from hil.record.traces.own_trace import NONE
from hil.roster import FIRMWARE, OPERATOR, again_name, processes, processes_of_a_run
from hil.run_files import RunFile
from hil.runs.job import Outcome, Progress, RunOptions
from hil.runs.supervision import BASELINE, Supervision, plan_of
from hil.scenario.scenario import Scenario
from hil.show.window import WINDOW, in_own_network
from hil.timing.clock import NS_PER_S, OPERATOR_PERIOD_S, MonotonicClock, TimeName
from hil.timing.loop import FixedRateLoop, LoopTiming, run_turns
from hil.timing.pacemaker import LONGEST_HOLD_NS, PACEMAKER, shared_turn_times
from hil.timing.realtime import OPERATOR_PRIORITY, fixed_priority, settle_garbage
from text_input import RefusalError

START_DELAY_S = 0.3
RECORDER = "recorder"
RECORDER_AT_WORK_S = 120.0
"""Time for the recorder to write frames left over from the run; on a busy machine this may be a whole run."""
LIVE = "live"
"""Name of the child that shows the run in a viewer."""
END_WAIT_S = 0.5
"""Time until a pacemaker that has been killed is seen to have ended."""
END_TIMEOUT_S = 5.0
LONGEST_WAIT_S = 60.0
"""Time for the program of `--firmware none` to send its first heartbeat."""
LOOK_S = 0.05
GRACE_S = 1.0
"""Time after the longest hold in which the pacemaker itself ends the run; it may have been stopped."""


LATE = ("hub", PACEMAKER, *processes_of_a_run())
"""The processes that can hold up a run, without this one."""


class BenchError(RefusalError, RuntimeError):
    """A run could not be started."""


def program() -> str:
    """Path of the installed `vibrohil`, so that the list of processes shows the nodes by this name."""
    beside = Path(sys.executable).with_name("vibrohil")
    found = str(beside) if beside.exists() else shutil.which("vibrohil")
    if found is None:
        raise BenchError(f"no program vibrohil beside {sys.executable} or on PATH; run `make setup`")
    return found


@dataclass
class ProcessesRun:
    """One run in real time, with a process for each node.

    The bus of `options` is `provided` during the run.
    """

    scenario: Scenario
    options: RunOptions
    run_dir: Path
    seed: int
    outcome: Outcome
    progress: Progress
    provided: ProvidedBus = field(init=False)
    turn_times: int | None = field(default=None, init=False)
    """Descriptor of the memory for the turns' times, if time is held."""
    operator_counters: dict[str, Any] = field(default_factory=dict, init=False)
    giver: TurnSocket | None = field(default=None, init=False)
    """The operator's connection to the pacemaker, if time is held."""
    ended_early: bool = field(default=False, init=False)
    """Whether turns ended before the script."""
    waited_for: str | None = field(default=None, init=False)
    """The process that was waited for longer than the longest hold."""
    children: dict[str, Child] = field(default_factory=dict, init=False)

    @cached_property
    def scripted(self) -> ProcessFaults:
        """The script's faults of processes."""
        return ProcessFaults(self.scenario.faults)

    @cached_property
    def restarted(self) -> dict[str, str]:
        """The processes that are restarted, by the names of those that replace them."""
        return {again_name(one.process): one.process for one in self.scripted.restarts()}

    def run(self) -> None:
        """Provide the bus, run on it, and note how it ended."""
        run_folder.note(self.run_dir, bus=self.options.bus, kernel_can=False)
        with ExitStack() as stack:
            if self.options.time == "held" and self.options.firmware != NONE:
                self.turn_times = shared_turn_times()
                stack.callback(os.close, self.turn_times)
            self.provided = stack.enter_context(shared(provide(self.options.bus, self.turn_times)))
            holders, bridge = self.provided.processes, self.provided.bridge
            time_name: TimeName = "strict" if self.provided.turns is None else "held"
            run_folder.note(self.run_dir, time=time_name, **self.provided.described)
            self.run_on_bus()
        if bridge is not None:
            run_folder.note(self.run_dir, bridge=asdict(bridge.counted_for(BusCounters())))
        if self.provided.said:
            said = json.loads(self.provided.said)
            self.note_holds(said)
            run_folder.note(self.run_dir, bus_said=said)
        self.note_killed({**self.children, **holders})

    def run_on_bus(self) -> None:
        """Start the processes, watch them to their end, and stop them in order."""
        self.clock = MonotonicClock()
        with ExitStack() as stack:
            stack.callback(self.stop_all)
            self.start()
            operator_bus = self.joined_as_operator(stack)
            if self.options.firmware == NONE:
                self.await_controller(operator_bus)
            pace = Pace(self.scenario.period_s, self.scenario.duration_s)
            faults = of_a_node(self.scenario.faults)
            line = FaultyBus(operator_bus, OPERATOR, faults, self.seed, self.scenario.period_s)
            traces = traces_in(self.run_dir, pace)
            operator = OperatorRunner.make(Making(self.scenario, self.seed, pace, line, faults, traces))
            stack.callback(operator.close)
            settle_garbage()
            stack.callback(gc.unfreeze)
            t0_ns = self.clock.now_ns() + round(START_DELAY_S * NS_PER_S)
            began_s = time.monotonic() + START_DELAY_S
            wall_start_ns = time.time_ns() + t0_ns - self.clock.now_ns()
            run_folder.note(self.run_dir, t0_ns=t0_ns, wall_start_s=wall_start_ns / NS_PER_S)
            for name, child in self.children.items():
                if name not in self.restarted:
                    child.start(Start(t0_ns))
            if self.provided.pacemaker is not None:
                self.provided.pacemaker.tell(plan_of(self.scenario, t0_ns).as_line())
            try:
                self.watch(operator, t0_ns)
                if not self.outcome.reasons and not self.ended_early:
                    self.await_ends()
            finally:
                self.operator_counters = {**asdict(operator_bus.counters), FAULTS_ACTED: effects_of([faults])}
                self.outcome.wall_s = max(0.0, time.monotonic() - began_s)

    def joined_as_operator(self, stack: ExitStack) -> Bus:
        """Join the bus, and the pacemaker if there is one."""
        address, turns = self.provided.address, self.provided.turns
        places = addresses_from(self.scenario.parameters)
        accept = [bus_id(places, can_id) for can_id in OperatorRunner.accepted_ids]
        if turns is None:
            bus = join(address, accept)
        else:
            bus, self.giver = join_in_turns(address, turns, OPERATOR, accept)
            self.giver.patience_s = LONGEST_HOLD_NS / NS_PER_S + GRACE_S
            stack.callback(self.giver.close)
        stack.callback(bus.close)
        return addressed(bus, places)

    def await_controller(self, bus: Bus) -> None:
        """Wait for the first heartbeat of the program that is the controller.

        Raises ChildError if none comes.
        """
        address = self.provided.address
        how = f"--bus {address} (python-can: {address.replace('local:', 'vibrohil:', 1)})"
        print(f"waiting for a controller: it joins with {how} and sends its heartbeat", file=sys.stderr)
        until_s = time.monotonic() + LONGEST_WAIT_S
        while not bus.receive():
            if time.monotonic() > until_s:
                raise ChildError(
                    f"no FirmwareHeartbeat within {LONGEST_WAIT_S:g} s; start a controller with {how}"
                )
            time.sleep(LOOK_S)

    def note_endless_hold(self, t_s: float) -> None:
        """Say why turns ended before the script although no process has ended: one of them is late for ever.

        A process that is computing is late by its own fault; otherwise the run proves nothing.
        """
        running = {name: child for name, child in self.watched.items() if not child.ended}
        late = [name for name, child in running.items() if name in LATE and has_stopped(child.pid)]
        busy = [name for name, child in running.items() if name in LATE and is_busy(child.pid)]
        longest = f"for more than {LONGEST_HOLD_NS / NS_PER_S:g} s"
        if busy and not late:
            self.outcome.reasons.append(f"{busy[0]} computed in one tick {longest}")
            return
        self.waited_for = late[0] if late else None
        self.outcome.cut_s, self.outcome.cut_by = t_s, self.waited_for or "run"
        self.outcome.not_judged.append(f"the host held up the {self.outcome.cut_by} {longest} at {t_s:.2f} s")

    def note_holds(self, said: Mapping[str, Any]) -> None:
        """Add the pacemaker's report on holds to the outcome."""
        self.outcome.held_s, self.outcome.own_late_s = said.get("held_s"), said.get("own_late_s")
        self.outcome.holds = said.get("holds", [])

    @property
    def watched(self) -> dict[str, Child]:
        """Every process whose end ends the run; the viewer is excluded, since it may be closed."""
        needed = {name: child for name, child in self.children.items() if name != LIVE}
        return {**self.provided.processes, **needed}

    def commands(self) -> dict[str, list[str]]:
        """The command line of each child, in the order in which they are stopped."""
        address = self.provided.address
        scenario = str(self.run_dir / RunFile.SCENARIO)
        duration = str(self.scenario.duration_s)
        common = ["--bus", address, "--out", str(self.run_dir), "--until", duration]
        common += ["--seed", str(self.seed), "--firmware", self.options.firmware]
        if self.provided.turns is not None:
            common += ["--turns", str(self.provided.turns)]
        recorder = [sys.executable, "-P", "-m", "hil.show.recorder", str(self.run_dir), "--bus", address]
        if self.provided.turns is not None:
            recorder += ["--turn-times", str(self.turn_times)]
        python = [sys.executable, "-P", "-m"]
        baseline = [*python, "hil.processes.baseline", "--ticks", str(self.scenario.ticks)]
        live = [*python, "hil.show.live", str(self.run_dir), "--to", str(self.options.viewer)]
        live = in_own_network(live) if self.options.viewer == WINDOW else live
        # What the operator talks to is stopped first: the nodes in the reversed order of a tick.
        nodes = {
            name: [program(), "node", process, scenario, *common]
            for name, process in [*((name, name) for name in reversed(processes())), *self.restarted.items()]
            if name != FIRMWARE or self.options.firmware != NONE
        }
        for name in self.restarted:
            nodes[name].append("--again")
        return {
            **nodes,
            BASELINE: baseline,
            RECORDER: recorder,
            **({} if self.options.viewer is None else {LIVE: live}),
        }

    def start(self) -> None:
        """Start the children together and wait until each is warmed up and on the bus."""
        self.progress(0.0, f"starting on {self.provided.name}")
        for name, command in self.commands().items():
            inherited = [self.turn_times] if name == RECORDER and self.turn_times is not None else []
            self.children[name] = Child(name, command, self.run_dir / f"{name}.log", inherited)
        pids = {name: child.pid for name, child in self.watched.items()}
        run_folder.write_json(self.run_dir / RunFile.PROCESSES, {"operator": os.getpid(), **pids})
        allowed = {}
        for name, child in self.children.items():
            if said := child.wait_ready():
                allowed[name] = json.loads(said)
        run_folder.note(self.run_dir, realtime=allowed)

    def watch(self, operator: OperatorRunner, t0_ns: int) -> None:
        """Act as the operator, and supervise the other processes in between.

        Ends with the script, or `REACTION_S` after a child has ended.
        """
        supervision = Supervision(
            self.scenario,
            self.watched,
            self.outcome,
            self.progress,
            pauses=self.giver is None,
            is_out_of_turns=lambda: self.is_out_of_turns,
            t0_ns=t0_ns,
        )
        with fixed_priority(OPERATOR_PRIORITY):
            reached = self.play(operator, supervision)
        if self.giver is not None:
            self.ended_early = reached < supervision.periods - 1
            if self.ended_early and self.provided.pacemaker is not None:
                self.provided.pacemaker.wait(END_WAIT_S)
        supervision.look(reached)
        if self.ended_early and not self.outcome.reasons:
            self.note_endless_hold(reached * OPERATOR_PERIOD_S)
        supervision.note_memory()

    @property
    def is_out_of_turns(self) -> bool:
        """Whether the nodes have ended, or are about to, because no more turns are given."""
        pacemaker = self.provided.pacemaker
        return pacemaker is not None and (self.ended_early or pacemaker.ended)

    def play(self, operator: OperatorRunner, supervision: Supervision) -> int:
        """Make the operator's steps, and supervise in between; return its last period.

        In its turns, or, in strict time, by the wall clock.
        """
        period_s, giver = self.scenario.period_s, self.giver
        ticks_a_period = round(OPERATOR_PERIOD_S / period_s)
        loop = FixedRateLoop(self.clock, supervision.t0_ns, round(period_s * NS_PER_S))
        reached = 0

        def step(tick: int) -> int:
            supervision.act(tick * period_s)
            if tick >= operator.due_tick:
                operator.bus.move_to(tick * period_s)
                operator.step(tick)
            return operator.due_tick if giver is not None else tick + 1  # signals have times of their own

        def supervise(tick: int, _: LoopTiming) -> None:
            nonlocal reached
            reached = tick // ticks_a_period
            if supervision.attend(reached):
                loop.stop() if giver is None else giver.leave()

        if giver is None:
            loop.run(self.scenario.ticks, step, supervise)
            self.continue_paused()
        else:
            run_turns(giver, step, supervise)
        return reached

    def continue_paused(self) -> None:
        """End the nodes that are paused beyond the end of the script; as in lockstep, they tick no more."""
        for process in self.scripted.paused_at(self.scenario.duration_s):
            self.children[process].signal(signal.SIGTERM)
            self.children[process].signal(signal.SIGCONT)

    def await_ends(self) -> None:
        """Wait for the loops, which end by themselves within a tick or two after the script."""
        for name, child in self.children.items():
            if name not in (*processes_of_a_run(), BASELINE) or self.scripted.kills(name):
                continue
            if not child.wait(END_TIMEOUT_S):
                self.outcome.reasons.append(f"{name} did not end within {END_TIMEOUT_S:g} s of the script")
            elif not child.succeeded:
                self.outcome.reasons.append(f"{child.how_it_ended()}{child.why()}")

    def note_dead_recorder(self) -> None:
        """Add a reason if the recorder was killed between its last check and its end."""
        recorder = self.children.get(RECORDER)
        has_run = self.outcome.wall_s > 0.0
        if recorder is None or not has_run or recorder.succeeded or recorder.killed_at_stop:
            return
        if not any(reason.startswith(RECORDER) for reason in self.outcome.reasons):
            self.outcome.reasons.append(f"{recorder.how_it_ended()} at the end{recorder.why()}")

    def note_killed(self, children: Mapping[str, Child]) -> None:
        """Add a reason for each process that had to be killed, except one that is waited for in vain."""
        self.outcome.reasons += [
            f"{name} did not end when asked to, and was killed"
            for name, child in children.items()
            if child.killed_at_stop and name not in (LIVE, self.waited_for)
        ]

    def note_fault_effects(self, nodes: Mapping[str, dict[str, Any]]) -> None:
        """Move the nodes' counts of what the faults acted on to the outcome.

        The counts are unknown if a node has left none because it was killed. Faults of processes are not
        counted: this process makes them act by signals and turns.
        """
        counts = {name: one.pop(FAULTS_ACTED) for name, one in nodes.items() if FAULTS_ACTED in one}
        if set(counts) != {OPERATOR, *processes_of_a_run()} & {OPERATOR, *self.children}:
            return
        self.outcome.faults_acted = [
            None if isinstance(fault, ProcessFault) else sum(its_counts)
            for fault, *its_counts in zip(self.scenario.faults, *counts.values(), strict=True)
        ]

    def stop_all(self) -> None:
        """Stop the children that still run, nodes before the recorder, and record their final reports."""
        said = {
            name: child.stop(RECORDER_AT_WORK_S if name == RECORDER else 0.0).strip()
            for name, child in self.children.items()
        }
        nodes = {name: json.loads(line) for name, line in said.items() if line.startswith("{")}
        if self.operator_counters:
            nodes[OPERATOR] = self.operator_counters
        self.note_fault_effects(nodes)
        run_folder.note(self.run_dir, nodes=nodes)
        for name, one in nodes.items():
            if lost := one.get("lost_records", 0):
                self.outcome.reasons.append(f"{name}: no room on the disk for its last {lost} records")
        self.note_dead_recorder()
        self.outcome.baseline_overruns = nodes.get(BASELINE, {}).get("overruns")
