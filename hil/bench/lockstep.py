"""Lockstep: all nodes in one process, in exactly the order of real time, as fast as possible.

At t_k the plant publishes and advances under the frames that arrived before t_k; the operator sends. At
t_k + T/2 the firmware ticks on the frames that have arrived; its torque acts from t_{k+1}. The nodes, their
frames and the codec between them are those of real time.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_py.shell.builds import NATIVE
from firmware_py.shell.node import MakeNode
from hil.bench import beginning
from hil.bench.ending import Outcome
from hil.bench.lockstep_bus import FIRMWARE, NODES, OPERATOR, PLANT, BusAsModelled, IdealBus, LockstepBus
from hil.bus.can_log import CanLog
from hil.faults.clocks import Turns, in_turns
from hil.faults.fault import Fault, effects_of, of_a_node
from hil.faults.line import FaultyBus
from hil.faults.memory import ParameterMemory
from hil.faults.processes import ProcessFaults
from hil.nodes.own_controller import MakeRunner, runner_of
from hil.nodes.runners import FirmwareRunner, OperatorRunner, Pace, PlantRunner
from hil.record import run_folder
from hil.scenario.scenario import Scenario
from hil.timing.clock import NS_PER_S
from hil.timing.loop import UNTIMED, LoopTiming
from hil.timing.memory import SETTLING_SHARE, MemoryWatch
from hil.timing.signals import delayed_signals
from plant_sim.kernels import IS_INTERPRETED
from plant_sim.scene import Scene

if TYPE_CHECKING:
    from hil.bench.stretches import RecordedStretches

Progress = Callable[[float, str], None]
"""Called with the completed share of the run, 0…1, and the present activity."""


def silent(_: float, __: str) -> None:
    """Show no progress."""


WARM_TICKS = 50
WARM: list[tuple[Scene, bool, str]] = []
"""Compiled or loaded combinations in this process: scene, whether the bus is ideal, and build."""
PROGRESS_S = 0.5
"""Simulated time between two reports of progress, at most twice this."""
NS_PER_US = 1000
BENCH = "bench"
"""Name, among those of the nodes, under which faults of processes and of the modelled bus are counted."""


def run_lockstep(
    scenario: Scenario,
    run_dir: Path,
    seed: int,
    progress: Progress,
    build: str = "python",
    make: MakeNode | None = None,
    faults: Mapping[str, Sequence[Fault]] | None = None,
) -> int:
    """Run the whole scenario; write traces and can.log to `run_dir`. Times in can.log are simulated times.

    `make` replaces the firmware node of `build`, for example by one that measures. `faults`: the scenario's
    faults for each node (`faults_by_node`), whose effects are counted. Returns the number of records for
    which the disk had no room.
    """
    faults = faults_by_node(scenario) if faults is None else faults
    with ExitStack() as stack:
        make_runner = runner_of(build) if make is None else partial(FirmwareRunner, make=make)
        nodes = LockstepNodes(scenario, run_dir, seed, faults, make_runner, stack)
        stretches = nodes.stretches() if build in NATIVE and make is None else None
        tick, ticks_in_all = 0, scenario.ticks
        progress_ticks = round(PROGRESS_S / scenario.period_s)
        shown_tick = 0
        while tick < ticks_in_all:
            if tick >= shown_tick:
                progress(tick / ticks_in_all, "running in lockstep")
                shown_tick = tick + progress_ticks
            with delayed_signals():
                ticks = 0 if stretches is None else min(stretches.ticks_from(tick), progress_ticks)
                if stretches is not None and ticks > 0:
                    stretches.record(tick, ticks)
                    tick += ticks
                else:
                    nodes.tick(tick)
                    tick += 1
    return nodes.lost_records


def faults_by_node(scenario: Scenario) -> dict[str, list[Fault]]:
    """The scenario's faults for each node, and for the bench itself."""
    return {name: of_a_node(scenario.faults) for name in (*NODES, BENCH)}


class LockstepNodes:
    """The nodes of lockstep on their bus, and the order in which they act in a tick."""

    def __init__(
        self,
        scenario: Scenario,
        run_dir: Path | None,
        seed: int,
        faults: Mapping[str, Sequence[Fault]],
        make_runner: MakeRunner,
        stack: ExitStack,
    ) -> None:
        """`run_dir`: None for compiled stretches that are not recorded. `stack` closes the files."""
        self._scenario = scenario
        self._bus: LockstepBus = IdealBus()
        if scenario.bitrate is not None and run_dir is not None:
            self._bus = BusAsModelled(scenario.bitrate, run_dir, faults[BENCH])
        pace = Pace(scenario.period_s, scenario.duration_s, is_timed=False)
        joined = {name: self._bus.join(name) for name in NODES}
        self.to_plant, self.to_operator = joined[PLANT], joined[OPERATOR]
        self.lines = {}
        for name, bus in joined.items():
            own = [fault for fault in faults[name] if not self._bus.breaks_by(fault)]
            self.lines[name] = FaultyBus(bus, name, own, seed, pace.period_s)
        self.plant = PlantRunner(scenario.scene, seed, pace, self.lines[PLANT], run_dir, faults[PLANT])
        memory = ParameterMemory(scenario.parameters, faults[FIRMWARE], seed)
        walks = scenario.scene.gait is not None
        self.firmware = make_runner(memory, pace, self.lines[FIRMWARE], run_dir, walks)
        self._plant = in_turns(self.plant, PLANT, faults[PLANT], pace.period_s, seed)
        self._firmware = in_turns(self.firmware, FIRMWARE, faults[FIRMWARE], pace.period_s, seed)
        self.operator = OperatorRunner(scenario.commands, pace, self.lines[OPERATOR], run_dir)
        self._processes = ProcessFaults(faults[BENCH])
        can_log = Path(os.devnull) if run_dir is None else run_dir / "can.log"
        self._can_log = stack.enter_context(CanLog(can_log))
        for node in (self._plant, self._firmware, self.operator, self._bus):
            stack.callback(node.close)
        self._period_ns = round(scenario.period_s * NS_PER_S)

    def stretches(self) -> "RecordedStretches | None":
        """The compiled stretches of a run on the ideal bus; None where Python runs all kernels."""
        if IS_INTERPRETED or not isinstance(self._bus, IdealBus):
            return None
        from hil.bench.stretches import RecordedStretches  # noqa: PLC0415 - imports compiled code

        turns = [node for node in (self._plant, self._firmware) if isinstance(node, Turns)]
        return RecordedStretches(self._scenario, self, turns, self._can_log)

    def tick(self, tick: int) -> None:
        """Run one tick: the plant and the operator at t_k, the firmware half a period later."""
        t_s, t_ns, half_ns = tick * self._scenario.period_s, tick * self._period_ns, self._period_ns // 2
        if self._processes.takes_turn(PLANT, t_s):
            self.lines[PLANT].move_to(t_s)
            self._plant.step(tick)
            self._plant.record(tick, UNTIMED)
        if self.operator.due_tick <= tick:
            self.lines[OPERATOR].move_to(t_s)
            self.operator.step(tick)
        self._pass_time(t_ns, t_ns + half_ns)
        if self._processes.takes_turn(FIRMWARE, t_s):
            started_ns = time.perf_counter_ns()
            self.lines[FIRMWARE].move_to(t_s)
            self._firmware.step(tick)
            work_us = (time.perf_counter_ns() - started_ns) * 1e-3
            self._firmware.record(tick, LoopTiming(0, 0.0, work_us, 0))
        self._pass_time(t_ns + half_ns, t_ns + self._period_ns)

    def _pass_time(self, from_ns: int, to_ns: int) -> None:
        """Advance the bus, and log its frames."""
        for logged_ns, frames in self._bus.pass_time(from_ns, to_ns):
            self._can_log.write(logged_ns // NS_PER_US, frames)

    @property
    def lost_records(self) -> int:
        """Records for which the disk had no room."""
        return self.plant.lost_records + self.firmware.lost_records


def in_lockstep(
    scenario: Scenario, out_dir: Path | None, seed: int, progress: Progress, firmware: str = "python"
) -> tuple[Path, Outcome]:
    """Run in this process without a judgement; return the run folder and the outcome."""
    outcome = Outcome()
    with run_folder.claimed(scenario.name, out_dir) as run_dir:
        beginning.begin(run_dir, scenario, "lockstep", seed)
        simulate(scenario, run_dir, seed, outcome, progress, firmware)
        run_folder.write_json(run_dir / "outcome.json", vars(outcome))
    return run_dir, outcome


def simulate(
    scenario: Scenario,
    run_dir: Path,
    seed: int,
    outcome: Outcome,
    progress: Progress,
    firmware: str = "python",
) -> None:
    """Run in this process; times are simulated from 0, so that two runs with the same seed are identical."""
    bus = {"bus": "in-process", "bus_reason": "lockstep", "kernel_can": False}
    run_folder.note(run_dir, **bus, t0_ns=0, wall_start_s=0.0)
    run_folder.write_json(run_dir / "processes.json", {"lockstep": os.getpid()})
    progress(0.0, "compiling kernels")
    warm_lockstep(scenario, firmware, run_dir)
    started = time.perf_counter()
    memory = MemoryWatch({"lockstep": os.getpid()})

    def watched(done: float, doing: str) -> None:
        memory.sample()
        progress(done, doing)

    faults = faults_by_node(scenario)
    try:
        if lost := run_lockstep(scenario, run_dir, seed, watched, firmware, faults=faults):
            outcome.reasons.append(f"no room on the disk for the last {lost} records")
    finally:
        outcome.wall_s = time.perf_counter() - started
        outcome.faults_acted = list(effects_of(faults.values()))
    if any(check.name.startswith("memory.") for check in scenario.checks):
        outcome.memory_growth_mb = memory.growth_mb()
        outcome.memory_watched_s = (1.0 - SETTLING_SHARE) * scenario.duration_s


def warm_lockstep(scenario: Scenario, firmware: str, run_dir: Path) -> None:
    """Compile or load all code that a run needs, by a short run whose records are discarded.

    This takes place once per process for each scene, kind of bus and build.
    """
    kind = scenario.scene, scenario.bitrate is None, firmware
    if kind in WARM:
        return
    moment = replace(scenario, duration_s=WARM_TICKS * scenario.period_s, commands=(), faults=())
    folder = run_dir / run_folder.WARM_UP
    folder.mkdir()
    try:
        run_lockstep(moment, folder, 0, silent, firmware)
        WARM.append(kind)
    finally:
        run_folder.discard(folder)
