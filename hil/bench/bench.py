"""A whole run: folder, bus, processes, common start, supervision, and the finished log.

In real time this process acts as the operator at 100 Hz and monitors the other processes in between: a child
that ends early is reported within 100 ms, the others continue for half a second so that their reaction is
logged, then all are stopped in order and the run folder is completed as after any run.
"""

import gc
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_py.shell.builds import Build
from firmware_py.shell.parameters import addresses_from
from hil.bench import beginning
from hil.bench.ending import Outcome, ending_with_a_verdict
from hil.bench.lockstep import Progress, simulate
from hil.bench.soak import SAMPLE_S, SETTLING_SHARE, MemoryWatch
from hil.bus import ProvidedBus, join, provide
from hil.bus.addressed import addressed
from hil.bus.base import BusError
from hil.faults.line import with_faults
from hil.faults.processes import FIRMWARE, ProcessFaults
from hil.nodes.runners import OperatorRunner, Pace
from hil.record import run_folder
from hil.scenario.operator import OPERATOR_PERIOD_S
from hil.scenario.scenario import Scenario, refuse_modelled_bus, refuse_other_periods
from hil.show.live import show
from hil.timing.clock import NS_PER_S, ClockName, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.patient_clock import PatientClock, Row, shared_memory
from hil.timing.processes import Child, Start
from hil.timing.realtime import OPERATOR_PRIORITY, fixed_priority, settle_garbage

READY_TIMEOUT_S = 120.0
"""Longest start of a child, with imports and kernels to compile, on a busy machine."""
START_DELAY_S = 0.3
RECORDER = "recorder"
RECORDER_AT_WORK_S = 120.0
"""Time for the recorder to write frames left over from the run; on a busy machine this may be a whole run."""
LIVE = "live"
"""Name of the child that shows the run in a viewer."""
PERIODS_A_LOOK = 10
"""Operator's periods between two checks of the other processes."""
REACTION_S = 0.5
"""Time for which the surviving nodes are recorded after a node has died."""
END_TIMEOUT_S = 5.0
END_SLACK_S = 0.1
"""A loop may complete its ticks and end by this time before the operator's last period."""


def again_name(process: str) -> str:
    """Name of the process that replaces a restarted one."""
    return f"{process}-again"


ROWS = {
    "firmware": Row.FIRMWARE,
    "plant": Row.PLANT,
    again_name("firmware"): Row.FIRMWARE_AGAIN,
    again_name("plant"): Row.PLANT_AGAIN,
}
"""The nodes' rows in the patient clocks' shared memory."""


class BenchError(RuntimeError):
    """A run could not be started."""


def run_scenario(
    scenario: Scenario,
    clock: ClockName,
    bus: str,
    out_dir: Path | None,
    seed: int,
    progress: Progress,
    viewer: str | None = None,
    only_if_failed: bool = False,
    firmware: Build = "python",
    of_a_suite: bool = False,
    keep_traces: bool = True,
) -> dict[str, Any]:
    """Run `scenario` and return its verdict; all files of the run are in its folder.

    `viewer`: URL of an open viewer, which shows the run: in real time during the run, in lockstep at its end.
    `only_if_failed`: a run that has passed leaves only its verdict. `of_a_suite`: an interrupted run is not
    judged. `keep_traces`: if False, the traces of a run that has passed are removed; its log remains.
    """
    prepare(firmware, clock)
    if clock != "lockstep":
        refuse_other_periods(scenario.period_s)
        refuse_modelled_bus(scenario)
    with run_folder.claimed(scenario.name, out_dir) as run_dir:
        beginning.begin(run_dir, scenario, clock, seed)
        run_folder.note(run_dir, firmware=firmware)
        with ending_with_a_verdict(run_dir, only_if_failed, of_a_suite) as ending:
            if clock == "lockstep":
                simulate(scenario, run_dir, seed, ending.outcome, progress, firmware)
            else:
                patient, outcome = clock == "patient", ending.outcome
                run = ProcessesRun(scenario, run_dir, seed, bus, patient, outcome, progress, viewer, firmware)
                run.run()
            progress(1.0, "writing log and verdict")
        if viewer is not None and clock == "lockstep":
            show(run_dir, viewer)
        if not keep_traces and ending.verdict["passed"]:
            run_folder.keep_the_log(run_dir)
    return ending.verdict


def prepare(firmware: Build, clock: ClockName) -> None:
    """Make the image of an emulated build; raises BoardError if the build cannot run here."""
    match firmware:
        case "python" | "compiled" | "host-single":
            return
    from firmware_py.builds.board import BoardError, image  # noqa: PLC0415 - imports LLVM

    if clock != "lockstep":
        raise BoardError(
            f"--firmware {firmware} with --clock {clock}: an emulated board keeps no wall clock's time; "
            "give --clock lockstep"
        )
    image(firmware)


def program() -> str:
    """Path of the installed `vibrohil`, so that the list of processes shows the nodes by this name."""
    beside = Path(sys.executable).with_name("vibrohil")
    found = str(beside) if beside.exists() else shutil.which("vibrohil")
    if found is None:
        raise BenchError(f"no program vibrohil beside {sys.executable} or on PATH; run `make setup`")
    return found


@dataclass
class ProcessesRun:
    """One run on the wall clock, or on patient clocks, with a process for each node.

    `bus` requests or names the bus, which is `provided` during the run.
    """

    scenario: Scenario
    run_dir: Path
    seed: int
    bus: str
    patient: bool
    outcome: Outcome
    progress: Progress
    viewer: str | None = None
    firmware: Build = "python"
    provided: ProvidedBus = field(init=False)
    children: dict[str, Child] = field(default_factory=dict, init=False)

    def run(self) -> None:
        """Provide the bus, run on it, and note how it ended."""
        run_folder.note(self.run_dir, bus=self.bus, kernel_can=False)
        with provide(self.bus) as self.provided:
            holders = self.provided.processes
            run_folder.note(self.run_dir, **self.provided.described)
            if self.patient and not self.provided.kernel_can:
                raise BusError(
                    f"bus {self.provided.name} ({self.provided.reason}): patient clocks need a bus that "
                    "delivers at once; wanted vcan, or "
                    "`vibrohil kernel -- vibrohil run … --clock patient --bus vcan`"
                )
            self.run_on_bus()
        self.note_killed(holders)
        if self.provided.said:
            run_folder.note(self.run_dir, bus_said=json.loads(self.provided.said))

    def run_on_bus(self) -> None:
        """Start, run, stop in order."""
        self.shared = shared_memory() if self.patient else -1
        self.clock = PatientClock(self.shared, Row.OPERATOR) if self.patient else MonotonicClock()
        with ExitStack() as stack:
            if self.patient:
                stack.callback(os.close, self.shared)
            stack.callback(self.stop_all)
            self.start_all()
            places = addresses_from(self.scenario.parameters)
            operator_bus = addressed(join(self.provided.address, accept=()), places)
            stack.callback(operator_bus.close)
            pace = Pace(self.scenario.period_s, self.scenario.duration_s)
            faulty_bus, set_time = with_faults(operator_bus, "operator", self.scenario.faults, self.seed)
            operator = OperatorRunner(self.scenario.commands, pace, faulty_bus, self.run_dir)
            stack.callback(operator.close)
            settle_garbage()
            stack.callback(gc.unfreeze)
            delay_s = 0.0 if self.patient else START_DELAY_S
            t0_ns = self.clock.now_ns() + round(delay_s * NS_PER_S)
            began_s = time.monotonic() + delay_s
            wall_start_ns = time.time_ns() + t0_ns - self.clock.now_ns()
            run_folder.note(self.run_dir, t0_ns=t0_ns, wall_start_s=wall_start_ns / NS_PER_S)
            later = {again_name(process) for _, process, _ in ProcessFaults(self.scenario.faults).restarts()}
            for name, child in self.children.items():
                if name not in later:
                    child.start(self.start_of(name, t0_ns))
            try:
                self.attend(operator, set_time, t0_ns)
                if not self.outcome.reasons:
                    self.await_ends()
            finally:
                self.outcome.wall_s = max(0.0, time.monotonic() - began_s)

    def start_of(self, name: str, t0_ns: int, first_tick: int = 0) -> Start:
        """The start message of a child process."""
        if not self.patient:
            return Start(t0_ns, first_tick)
        return Start(t0_ns, first_tick, self.shared, ROWS.get(name, -1))

    def restart(self, name: str, t0_ns: int, first_tick: int) -> None:
        """Start a process that replaces another."""
        if isinstance(self.clock, PatientClock):
            self.clock.expect(ROWS[name], t0_ns + round(first_tick * self.scenario.period_s * NS_PER_S))
        self.children[name].start(self.start_of(name, t0_ns, first_tick))

    @property
    def watched(self) -> dict[str, Child]:
        """Every process whose end ends the run; the viewer is excluded, since it may be closed."""
        needed = {name: child for name, child in self.children.items() if name != LIVE}
        return {**needed, **self.provided.processes}

    def commands(self) -> dict[str, list[str]]:
        """The command line of each child, in the order in which they are stopped."""
        address = self.provided.address
        scenario = str(self.run_dir / "scenario.toml")
        duration = str(self.scenario.duration_s)
        common = ["--bus", address, "--out", str(self.run_dir), "--sync", "--until", duration]
        common += ["--seed", str(self.seed)]
        python = [sys.executable, "-m"]
        baseline = [*python, "hil.timing.baseline", "--ticks", str(self.scenario.ticks)]
        live = [*python, "hil.show.live", str(self.run_dir), "--to", str(self.viewer)]
        restarts = ProcessFaults(self.scenario.faults).restarts()
        build = {FIRMWARE: ["--firmware", self.firmware]}
        again = {
            again_name(process): [program(), process, scenario, *common, *build.get(process, []), "--again"]
            for _, process, _ in restarts
        }
        return {
            "firmware": [program(), "firmware", scenario, *common, *build[FIRMWARE]],
            "plant": [program(), "plant", scenario, *common],
            **again,
            **({} if self.patient else {"baseline": baseline}),
            RECORDER: [*python, "hil.show.recorder", str(self.run_dir), "--bus", address],
            **({} if self.viewer is None else {LIVE: live}),
        }

    def start_all(self) -> None:
        """Start the children together and wait until each is warmed up and on the bus."""
        self.progress(0.0, f"starting on {self.provided.name}")
        descriptors = [self.shared] if self.patient else []
        for name, command in self.commands().items():
            self.children[name] = Child(name, command, self.run_dir / f"{name}.log", descriptors)
        pids = {name: child.pid for name, child in self.watched.items()}
        run_folder.write_json(self.run_dir / "processes.json", {"operator": os.getpid(), **pids})
        allowed = {}
        for name, child in self.children.items():
            if said := child.wait_ready(READY_TIMEOUT_S):
                allowed[name] = json.loads(said)
        run_folder.note(self.run_dir, realtime=allowed)

    def attend(self, operator: OperatorRunner, set_time: Callable[[float], None], t0_ns: int) -> None:
        """Act as the operator to the end of the script, or until `REACTION_S` after a child has ended."""
        with nullcontext() if self.patient else fixed_priority(OPERATOR_PRIORITY):
            try:
                self.play(operator, set_time, t0_ns)
            finally:
                self.clock.leave()

    def play(self, operator: OperatorRunner, set_time: Callable[[float], None], t0_ns: int) -> None:
        """Run the operator's loop, with periodic checks of the other processes."""
        period_ns = round(OPERATOR_PERIOD_S * NS_PER_S)
        loop = FixedRateLoop(self.clock, t0_ns, period_ns)
        periods = round(self.scenario.duration_s / OPERATOR_PERIOD_S)
        last_period = periods
        scripted = ProcessFaults(self.scenario.faults)
        signals, restarts = scripted.signals(), scripted.restarts()
        watched = self.watched
        dead: set[str] = set()
        memory = MemoryWatch({name: child.pid for name, child in watched.items()})
        next_look = 0
        next_sample_s = 0.0

        def step(period: int, _: int) -> None:
            nonlocal next_look
            t_s = period * OPERATOR_PERIOD_S
            while signals and signals[0].at_s <= t_s:
                self.children[signals[0].process].signal(signals[0].number)
                del signals[0]
            while restarts and restarts[0].at_s <= t_s:
                first_tick = round(restarts[0].start_s / self.scenario.period_s)
                self.restart(again_name(restarts[0].process), t0_ns, first_tick)
                del restarts[0]
            set_time(t_s)
            operator.step(period)
            if period >= min(next_look, last_period):
                next_look = period + PERIODS_A_LOOK
                look(period)
            if period >= last_period:
                loop.stop()

        def look(period: int) -> None:
            """Check the other processes and sample their memory, less often than commands are sent."""
            nonlocal last_period, next_sample_s
            t_s = period * OPERATOR_PERIOD_S
            for name, child in watched.items():
                if name not in dead and child.ended:
                    dead.add(name)
                    its_last_ticks = child.succeeded and t_s > self.scenario.duration_s - END_SLACK_S
                    if its_last_ticks or scripted.kills(name, by_s=t_s):
                        continue
                    self.outcome.reasons.append(f"{child.how_it_ended()} at {t_s:.2f} s{child.why()}")
                    last_period = min(last_period, period + round(REACTION_S / OPERATOR_PERIOD_S))
            self.progress(period / periods, "running")
            if t_s >= next_sample_s:
                next_sample_s += SAMPLE_S
                memory.sample()

        loop.run(periods, step, None)
        self.continue_paused()
        self.outcome.memory_growth_mb = memory.growth_mb()
        self.outcome.memory_watched_s = (1.0 - SETTLING_SHARE) * self.scenario.duration_s

    def continue_paused(self) -> None:
        """End the nodes that are paused beyond the end of the script; as in lockstep, they tick no more."""
        for process in ProcessFaults(self.scenario.faults).paused_at(self.scenario.duration_s):
            self.children[process].signal(signal.SIGTERM)
            self.children[process].signal(signal.SIGCONT)

    def await_ends(self) -> None:
        """Wait for the loops, which end by themselves within a tick or two after the script."""
        scripted = ProcessFaults(self.scenario.faults)
        later = [again_name(process) for _, process, _ in scripted.restarts()]
        for name, child in self.children.items():
            if name not in ("firmware", "plant", "baseline", *later):
                continue
            if scripted.kills(name):
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
        """Add a reason for each process that had to be killed."""
        self.outcome.reasons += [
            f"{name} did not end when asked to, and was killed"
            for name, child in children.items()
            if child.killed_at_stop
        ]

    def stop_all(self) -> None:
        """Stop the children that still run, nodes before the recorder, and record their final reports."""
        said = {
            name: child.stop(RECORDER_AT_WORK_S if name == RECORDER else 0.0).strip()
            for name, child in self.children.items()
        }
        nodes = {name: json.loads(line) for name, line in said.items() if line.startswith("{")}
        run_folder.note(self.run_dir, nodes=nodes)
        for name, one in nodes.items():
            if lost := one.get("lost_records", 0):
                self.outcome.reasons.append(f"{name}: no room on the disk for its last {lost} records")
        self.note_killed({name: child for name, child in self.children.items() if name != LIVE})
        self.note_dead_recorder()
        self.outcome.baseline_overruns = nodes.get("baseline", {}).get("overruns")
