"""Lockstep: all nodes in one process, in exactly the order that real time gives them, as fast as it goes.

At t_k the plant publishes and moves on under the frames that arrived before t_k; the operator sends. At
t_k + T/2 the firmware ticks on what has arrived; its torque acts from t_{k+1}. The nodes, their frames and
the codec between them are those of real time.
"""

import time
from collections.abc import Callable
from pathlib import Path

from hil.can_log import CanLog
from hil.clock import NS_PER_S
from hil.lockstep_bus import FIRMWARE, OPERATOR, PLANT, BusAsModelled, BusAtOnce, LockstepBus
from hil.loop import LoopTiming
from hil.nodes import FirmwareRunner, OperatorRunner, Pace, PlantRunner
from hil.operator import OPERATOR_PERIOD_S
from hil.scenario import Scenario

Progress = Callable[[float, str], None]
"""Told how much of the run is done, 0…1, and what is being done."""

PROGRESS_TICKS = 500
TIME_RESOLUTION_S = 1e-9
NS_PER_US = 1000


def run_lockstep(scenario: Scenario, run_dir: Path, seed: int, progress: Progress) -> None:
    """Run the whole scenario; traces and can.log go to `run_dir`. Times in can.log are simulated ones."""
    bus: LockstepBus = BusAtOnce() if scenario.bitrate is None else BusAsModelled(scenario.bitrate)
    pace = Pace(scenario.period_s, scenario.duration_s)
    plant = PlantRunner(scenario.scene, seed, pace, bus.join(PLANT), run_dir)
    firmware = FirmwareRunner(scenario.parameters, pace, bus.join(FIRMWARE), run_dir)
    operator = OperatorRunner(scenario.commands, pace, bus.join(OPERATOR), run_dir)
    period_ns = round(scenario.period_s * NS_PER_S)
    operator_period = 0
    now_ns = time.perf_counter_ns
    with CanLog(run_dir / "can.log") as can_log:
        for tick in range(scenario.ticks):
            t_ns = tick * period_ns
            plant.step(tick, 1)
            plant.record(tick, LoopTiming(0, 0.0, 0.0, 0))
            while operator_period * OPERATOR_PERIOD_S <= tick * scenario.period_s + TIME_RESOLUTION_S:
                operator.step(operator_period)
                operator_period += 1
            for logged_ns, frames in bus.pass_time(t_ns, t_ns + period_ns // 2):
                can_log.write(logged_ns // NS_PER_US, frames)

            started_ns = now_ns()
            firmware.step(tick, 1)
            work_us = (now_ns() - started_ns) * 1e-3
            firmware.record(tick, LoopTiming(0, 0.0, work_us, 0))
            for logged_ns, frames in bus.pass_time(t_ns + period_ns // 2, t_ns + period_ns):
                can_log.write(logged_ns // NS_PER_US, frames)
            if tick % PROGRESS_TICKS == 0:
                progress(tick / scenario.ticks, "running in lockstep")
    for node in (plant, firmware, operator):
        node.close()
