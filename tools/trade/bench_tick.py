"""Time of a tick of the bench: the plant alone, and the whole closed loop, both in compiled code.

The plant's tick is read sensors, a torque that holds the speed, and a step of the motion of 1 ms, on the
orbit with impacts of the default scenario.
"""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.nodes.firmware.runner import warm_firmware
from hil.nodes.plant.runner import PlantRunner
from hil.record.traces.plant_trace import PlantRecord
from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.scenario import Scenario
from plant_sim.kernels import jit
from plant_sim.plant import Plant
from plant_sim.sensors.readings import Readers, read_sensors
from plant_sim.solvers.adaptive.adaptive import DONE
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Run
from plant_sim.tick import move
from tools.trade.control_rate import short_start
from tools.trade.costs import Progress

TICKS = 20_000
SETTLE_TICKS = 10_000
GAIN_N_M_S, START_N_M = 0.05, 0.04
"""Proportional gain of the speed, and the torque at speed."""
KEPT = {"plant": PlantRecord._fields, "firmware": ("outputs.mode", "outputs.impact")}
UNIT = "µs of processor per tick, called from compiled code"


@jit
def run_ticks(
    module: Run, readers: Readers, noise: NDArray[np.float64], speed_rad_s: float, tick_s: float
) -> float:
    """Run a tick for each row of `noise`; return the sum of the readings of speed, nan if one failed."""
    total, memory = 0.0, module.memory[0]
    for row in range(noise.shape[0]):
        crank_rad, omega_rad_s = memory.observed[OBSERVED.crank_rad], memory.observed[OBSERVED.omega_rad_s]
        reading = read_sensors(readers, module.probe.readings, crank_rad, noise[row])
        total += reading.encoder_velocity_rev_s
        torque_n_m = START_N_M + GAIN_N_M_S * (speed_rad_s - omega_rad_s)
        memory.mode.impacts = 0
        if move(module, torque_n_m, tick_s) != DONE:
            return np.nan
    return total


def measure(repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Measure both ticks and return a row for each."""
    scenario = short_start()
    progress("tick of the bench")
    PlantRunner.warm(scenario)
    warm_firmware(scenario.parameters, "compiled")
    ticks = (("plant: motor, soft stop, sensors", _plant_us), ("closed loop with the firmware", _loop_us))
    return [
        {
            "what": f"tick: {name}",
            "kind": "tick",
            "cost": min(spent_us(scenario) for _ in range(repeats)),
            "unit": UNIT,
        }
        for name, spent_us in ticks
    ]


def _plant_us(scenario: Scenario) -> float:
    plant = Plant(scenario.scene, seed=1)
    speed_rad_s = scenario.commands[0].target_ratio * scenario.scene.natural_rad_s
    noise = np.random.default_rng(1).standard_normal((TICKS, 4))
    for rows in (noise[:SETTLE_TICKS], noise):
        begun = time.thread_time_ns()
        total = run_ticks(plant.run, plant.readers, rows, speed_rad_s, scenario.period_s)
        assert not np.isnan(total)
    return (time.thread_time_ns() - begun) * 1e-3 / TICKS


def _loop_us(scenario: Scenario) -> float:
    begun = time.thread_time_ns()
    ticks = sum(len(segment.rows["plant"]) for segment in segments(Job(scenario, 1, kept=KEPT)))
    return (time.thread_time_ns() - begun) * 1e-3 / ticks
