"""A walk with the gate: a motor with its limits, a noisy gait phase, modules sampled as in the campaigns."""

import math
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from firmware_py.core.control import gait
from firmware_py.core.inputs import GaitInput
from firmware_py.shell.parameters import config_from
from hil.scenario.scenario import read_scenario
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.walking import Walking
from plant_sim.plant import Plant
from plant_sim.scene import Scene, read_scene
from tools.campaign.trial.sampling import DEFAULT_SEED, Mismatch, sample
from tools.study.feasibility.feasibility import STEP_S, Driven
from tools.study.pulse.gate import Gate, initial, step
from tools.study.pulse.judging import COLUMNS, GATED, JUDGED, Walked, judged
from tools.study.pulse.turns import WALK

TICK_S = 1e-3
GAIT_TICKS = 5
SETTLING = 8
"""Strides before the first judged stride: the phase estimate needs three, and the crank is parked."""
SPEED_GAIN_N_M_S = 0.1
TORQUE_N_M, TORQUE_A_TICK_N_M = 0.6, 0.06
"""The firmware's limits on torque and on its change per tick."""
POSITION_ERROR_M = 1e-3
"""Standard deviation of the error of the striker's estimated position, in addition to the sampled module."""
SCENES = {
    "walking": ("walking", "a-fifth-more-strides-keep-the-impacts"),
    "table1": ("table1-walking", "a-steady-walk-has-a-pulse-in-every-push-off"),
}


def sampled_scene(module: str, stride_hz: float, walker: int) -> Scene:
    """Return the scene of a walker with a module sampled about its nominal values as in the campaigns."""
    given = deepcopy(read_scene(SCENES[module][0]))
    given["gait"]["pace"] = [{"at_s": 0.0, "stride_hz": stride_hz}]
    return sample(given, Mismatch(), DEFAULT_SEED, walker, at_rest=True).scene


def gated(module: str, stride_hz: float, walker: int, strides: int = SETTLING + JUDGED + 2) -> Walked:
    """Simulate a walk with the gate, tick by tick."""
    config = config_from(read_scenario(SCENES[module][1])["firmware"])
    gate = Gate(config.spin_down, config.gait_lock.lowest_confidence)
    plant = Plant(sampled_scene(module, stride_hz, walker), DEFAULT_SEED + walker)
    walking = plant.parts.housing
    assert isinstance(walking, Walking)
    nominal = config.spin_down
    spring_n_m = 0.8 * nominal.natural_rad_s**2
    off_m = POSITION_ERROR_M * float(np.random.default_rng([DEFAULT_SEED, walker, 4]).standard_normal())
    cycle, state = gait.INITIAL, initial(gate)
    newest = GaitInput(0.0, False, False, GAIT_TICKS)
    drive = plant.parts.drive
    assert isinstance(drive, MotorDrive)
    every = round(STEP_S / TICK_S)
    ticks = round(strides / stride_hz / TICK_S)
    felt_n, crank_rad = np.empty(ticks // every), np.empty(ticks // every)
    touching, torque_n_m, largest_n_m, copper_j = False, 0.0, 0.0, 0.0
    for k in range(ticks):
        reading = plant.sense_gait(plant.t_s) if k % GAIT_TICKS == 0 else None
        newest = (
            newest._replace(age_ticks=newest.age_ticks + 1)
            if reading is None
            else GaitInput(reading.shank_rate_rad_s, reading.heel_contact, reading.toe_contact, 0)
        )
        cycle = gait.step(config.gait, cycle, newest, 1)
        now = plant.now
        place_m = now.x_m + off_m
        touches = now.stop_force_n > 0.0
        state = step(
            gate,
            state,
            (cycle.phase, cycle.confidence, cycle.stride.expected_s),
            now.crank_rad,
            (place_m, now.v_m_s),
            touches and not touching,
        )
        touching = touches
        piston_m = nominal.amplitude_m * math.sin(now.crank_rad)
        lever_m = nominal.amplitude_m * math.cos(now.crank_rad)
        wanted_n_m = spring_n_m * (piston_m + nominal.rest_length_m - place_m) * lever_m
        wanted_n_m += SPEED_GAIN_N_M_S * (state.target_rad_s - now.omega_rad_s)
        wanted_n_m = min(max(wanted_n_m, -TORQUE_N_M), TORQUE_N_M)
        torque_n_m += min(max(wanted_n_m - torque_n_m, -TORQUE_A_TICK_N_M), TORQUE_A_TICK_N_M)
        plant.advance(torque_n_m, TICK_S)
        largest_n_m = max(largest_n_m, abs(torque_n_m))
        copper_j += drive.resistance_ohm * plant.now.current_a**2 * TICK_S
        if k % every == every - 1:
            felt_n[k // every], crank_rad[k // every] = plant.now.felt_force_n, plant.now.crank_rad
    t_s: NDArray[np.float64] = STEP_S * np.arange(1, len(felt_n) + 1, dtype=np.float64)
    seconds = ticks * TICK_S
    return Walked(
        Driven(plant.take_impacts(), t_s, crank_rad, felt_n),
        walking,
        largest_n_m,
        plant.energy.drive_work_j / seconds,
        copper_j / seconds,
    )


def gated_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """Compute the row of one module at one cadence, over all walkers."""
    module, hz = spec["module"], spec["stride_hz"]
    walks = [gated(module, hz, walker) for walker in range(spec["walkers"])]
    given = read_scene(SCENES[module][0])
    row = {
        "way": GATED,
        "module": module,
        "ground": WALK.name,
        "axis": given["gait"]["axis"],
        "stride_hz": hz,
        "turns": 0,
        "spring_n_m": given["striker"]["spring_n_m"],
        "amplitude_m": given["drive"]["amplitude_m"],
        "gap_m": given["stop"]["position_m"] - given["striker"]["rest_length_m"],
        "leg_alone_hz": math.nan,
        **judged(walks, SETTLING),
    }
    return pa.Table.from_pylist([row], schema=COLUMNS), {}
