"""Lockstep: all nodes in one process, in exactly the order that real time gives them, as fast as it goes.

At t_k the plant publishes and moves on under the frames that arrived before t_k; the operator sends. At
t_k + T/2 the firmware ticks on what has arrived; its torque acts from t_{k+1}. The nodes, their frames and
the codec between them are those of real time.
"""

import time
from collections.abc import Callable
from pathlib import Path

from hil.bus.in_process import InProcessBus
from hil.can_log import CanLog
from hil.loop import LoopTiming
from hil.nodes import FirmwareRunner, OperatorRunner, Pace, PlantRunner
from hil.operator import OPERATOR_PERIOD_S
from hil.scenario import Scenario

Progress = Callable[[float, str], None]
"""Told how much of the run is done, 0…1, and what is being done."""

PROGRESS_TICKS = 500
TIME_RESOLUTION_S = 1e-9


def run_lockstep(scenario: Scenario, run_dir: Path, seed: int, progress: Progress) -> None:
    """Run the whole scenario; traces and can.log go to `run_dir`. Times in can.log are simulated ones."""
    bus = InProcessBus()
    pace = Pace(scenario.period_s, scenario.duration_s)
    plant = PlantRunner(scenario.scene, seed, pace, bus.join(), run_dir)
    firmware = FirmwareRunner(scenario.parameters, pace, bus.join(), run_dir)
    operator = OperatorRunner(scenario.commands, pace, bus.join(listening=False), run_dir)
    listener = bus.join()
    period_us = scenario.period_s * 1e6
    operator_period = 0
    now_ns = time.perf_counter_ns
    with CanLog(run_dir / "can.log") as can_log:
        for tick in range(scenario.ticks):
            plant.step(tick, 1)
            plant.record(tick, LoopTiming(0, 0.0, 0.0, 0))
            while operator_period * OPERATOR_PERIOD_S <= tick * scenario.period_s + TIME_RESOLUTION_S:
                operator.step(operator_period)
                operator_period += 1
            can_log.write(round(tick * period_us), listener.receive())

            started_ns = now_ns()
            firmware.step(tick, 1)
            work_us = (now_ns() - started_ns) * 1e-3
            firmware.record(tick, LoopTiming(0, 0.0, work_us, 0))
            can_log.write(round((tick + 0.5) * period_us), listener.receive())
            if tick % PROGRESS_TICKS == 0:
                progress(tick / scenario.ticks, "running in lockstep")
    for node in (plant, firmware, operator):
        node.close()
