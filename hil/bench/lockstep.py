"""Lockstep: all nodes in one process, in exactly the order of real time, as fast as possible.

At t_k the plant publishes and advances under the frames that arrived before t_k; the operator sends. At
t_k + T/2 the firmware ticks on the frames that have arrived; its torque acts from t_{k+1}. The nodes, their
frames and the codec between them are those of real time.
"""

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from firmware_py.shell.builds import NATIVE, Build, node_of
from firmware_py.shell.node import MakeNode
from hil.bench import beginning
from hil.bench.ending import Outcome
from hil.bench.lockstep_bus import FIRMWARE, OPERATOR, PLANT, BusAsModelled, IdealBus, LockstepBus
from hil.bench.soak import SETTLING_SHARE, MemoryWatch
from hil.bus.can_log import CanLog
from hil.bus.in_process import InProcessNode
from hil.faults.clocks import Turns, in_turns
from hil.faults.line import with_faults
from hil.faults.processes import ProcessFaults
from hil.nodes.runners import FirmwareRunner, OperatorRunner, Pace, PlantRunner
from hil.record import run_folder
from hil.scenario.operator import OPERATOR_PERIOD_S
from hil.scenario.scenario import Scenario
from hil.timing.clock import NS_PER_S
from hil.timing.loop import LoopTiming
from plant_sim.scene import Scene

Progress = Callable[[float, str], None]
"""Called with the completed share of the run, 0…1, and the present activity."""


def silent(_: float, __: str) -> None:
    """Show no progress."""


WARM_TICKS = 50
WARM: list[tuple[Scene, bool, Build]] = []
"""Compiled or loaded combinations in this process: scene, whether the bus is ideal, and build."""
PROGRESS_S = 0.5
"""Simulated time between two reports of progress, at most twice this."""
TIME_RESOLUTION_S = 1e-9
NS_PER_US = 1000
UNTIMED = LoopTiming(0, 0.0, 0.0, 0)
"""Timing of the plant, which is not measured in lockstep."""


def run_lockstep(  # noqa: PLR0915 - the order of the nodes, read top to bottom
    scenario: Scenario,
    run_dir: Path,
    seed: int,
    progress: Progress,
    build: Build = "python",
    make: MakeNode | None = None,
) -> int:
    """Run the whole scenario; write traces and can.log to `run_dir`. Times in can.log are simulated times.

    `make` replaces the firmware node of `build`, for example by one that measures. Returns the number of
    records for which the disk had no room.
    """
    bus: LockstepBus = IdealBus() if scenario.bitrate is None else BusAsModelled(scenario.bitrate, run_dir)
    pace = Pace(scenario.period_s, scenario.duration_s, is_timed=False)
    faults = scenario.faults
    at_nodes = bus.break_by(faults)
    to_plant = bus.join(PLANT)
    plant_bus, set_plant_time = with_faults(to_plant, PLANT, at_nodes, seed)
    firmware_bus, set_firmware_time = with_faults(bus.join(FIRMWARE), FIRMWARE, at_nodes, seed)
    operator_bus, set_operator_time = with_faults(bus.join(OPERATOR), OPERATOR, at_nodes, seed)
    plant_node = PlantRunner(scenario.scene, seed, pace, plant_bus, run_dir, faults)
    plant = in_turns(plant_node, PLANT, faults, pace.period_s, seed)
    walks = scenario.scene.gait is not None
    firmware_node = FirmwareRunner(
        scenario.parameters,
        pace,
        firmware_bus,
        run_dir,
        faults,
        seed,
        walks=walks,
        make=make or node_of(build),
    )
    firmware = in_turns(firmware_node, FIRMWARE, faults, pace.period_s, seed)
    operator = OperatorRunner(scenario.commands, pace, operator_bus, run_dir)
    processes = ProcessFaults(faults)
    period_s, ticks_in_all = scenario.period_s, scenario.ticks
    plant_tick = firmware_tick = -1
    period_ns = round(period_s * NS_PER_S)
    operator_period = 0
    progress_ticks = round(PROGRESS_S / period_s)
    now_ns = time.perf_counter_ns
    with CanLog(run_dir / "can.log") as can_log, ExitStack() as stack:
        for node in (plant, firmware, operator, bus):
            stack.callback(node.close)
        stretches = None
        if build in NATIVE and make is None and isinstance(to_plant, InProcessNode):
            from hil.bench import stretches as compiled  # noqa: PLC0415 - imports compiled code

            if compiled.has_stretches(scenario):
                nodes = compiled.Nodes(plant_node, firmware_node, operator, to_plant)
                turns = [node for node in (plant, firmware) if isinstance(node, Turns)]
                stretches = compiled.RecordedStretches(scenario, nodes, turns, can_log)
        tick = 0
        while tick < ticks_in_all:
            ticks = 0 if stretches is None else min(stretches.ticks_from(tick), progress_ticks)
            if stretches is not None and ticks > 0:
                progress(tick / ticks_in_all, "running in lockstep")
                operator_period = stretches.run(tick, ticks, operator_period)
                tick += ticks
                plant_tick = firmware_tick = tick - 1
                continue
            t_ns = tick * period_ns
            t_s = tick * period_s
            if processes.runs(PLANT, t_s):
                set_plant_time(t_s)
                plant.step(tick, tick - plant_tick)
                plant.record(tick, UNTIMED)
                plant_tick = tick
            while operator_period * OPERATOR_PERIOD_S <= t_s + TIME_RESOLUTION_S:
                set_operator_time(operator_period * OPERATOR_PERIOD_S)
                operator.step(operator_period)
                operator_period += 1
            for logged_ns, frames in bus.pass_time(t_ns, t_ns + period_ns // 2):
                can_log.write(logged_ns // NS_PER_US, frames)

            if processes.runs(FIRMWARE, t_s):
                started_ns = now_ns()
                set_firmware_time(t_s)
                firmware.step(tick, tick - firmware_tick)
                work_us = (now_ns() - started_ns) * 1e-3
                firmware.record(tick, LoopTiming(0, 0.0, work_us, 0))
                firmware_tick = tick
            for logged_ns, frames in bus.pass_time(t_ns + period_ns // 2, t_ns + period_ns):
                can_log.write(logged_ns // NS_PER_US, frames)
            if tick % progress_ticks == 0:
                progress(tick / ticks_in_all, "running in lockstep")
            tick += 1
    return plant_node.lost_records + firmware_node.lost_records


def in_lockstep(
    scenario: Scenario, out_dir: Path | None, seed: int, progress: Progress, firmware: Build = "python"
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
    firmware: Build = "python",
) -> None:
    """Run in this process; times are simulated from 0, so that two runs with the same seed are identical."""
    bus = {"bus": "in-process", "bus_reason": "lockstep", "kernel_can": False, "counts_losses": True}
    run_folder.note(run_dir, **bus, t0_ns=0, wall_start_s=0.0)
    run_folder.write_json(run_dir / "processes.json", {"lockstep": os.getpid()})
    progress(0.0, "compiling kernels")
    warm_lockstep(scenario, firmware, run_dir)
    started = time.perf_counter()
    memory = MemoryWatch({"lockstep": os.getpid()})

    def watched(done: float, doing: str) -> None:
        memory.sample()
        progress(done, doing)

    try:
        if lost := run_lockstep(scenario, run_dir, seed, watched, firmware):
            outcome.reasons.append(f"no room on the disk for the last {lost} records")
    finally:
        outcome.wall_s = time.perf_counter() - started
    if any(check.name.startswith("memory.") for check in scenario.checks):
        outcome.memory_growth_mb = memory.growth_mb()
        outcome.memory_watched_s = (1.0 - SETTLING_SHARE) * scenario.duration_s


def warm_lockstep(scenario: Scenario, firmware: Build, run_dir: Path) -> None:
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
