"""The module without a controller: its crank has a given speed under any load.

That is the plant with a motor that has a huge flywheel and no losses: the same parts, so the same
kernels. It answers whether an impact attractor exists at a speed, how hard impacts are on the way up to it,
where an instant start ends, and where a kicked striker would have ended.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hil.record.traces.plant_trace import PlantRecord
from plant_sim.arrays import FloatArray
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop
from plant_sim.plant import Plant
from plant_sim.result import Impact, MotionState, Phase
from plant_sim.scene import Scene
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive.state_layout import APPROACH, IMPACT_TIME
from tools.output import BadInputError

FLYWHEEL_KG_M2 = 1e4
"""The module, whose mean load is below 0.1 N m, changes its speed by less than 0.001 rad/s in a minute."""
FLYWHEEL_V = 1e9
"""More than the back-EMF of a motor whose torque constant fits the flywheel."""
RAMP_S, HELD_S = 40.0, 20.0
"""Up to speed so slowly that the striker follows its attractor; then long enough for it to be left."""
SLOWEST = 0.4
"""Share of the speed at which the slow way up begins: below any impact."""
LONGEST_GAP = 2.2
"""Periods between two impacts of a motion that goes on impacting; some orbits have one every other period."""
JUDGED_S = 8.0
"""The end of a run that decides: twelve periods."""
KEPT = 2048
"""Answers, as a tuning runs many candidates on the same truths."""
TRIES = 12
"""Starts at speed that are tried where the slow way up has lost the attractor."""


class Reference(NamedTuple):
    """Whether impacts go on at the speed, the hardest v⁻ then, and the largest on the slow way up, m/s."""

    exists: bool
    hardest_m_s: float
    path_m_s: float


def led(parts: Parts) -> Parts:
    """The same module with a crank that a flywheel leads, and a motor that can accelerate it."""
    drive = parts.drive
    assert isinstance(drive, MotorDrive)
    return parts._replace(
        drive=drive._replace(
            inertia_kg_m2=FLYWHEEL_KG_M2,
            torque_constant_n_m_a=FLYWHEEL_KG_M2,
            supply_v=FLYWHEEL_V,
            viscous_n_m_s=0.0,
            dry_n_m=0.0,
        )
    )


def stop_m_of(scene: Scene) -> float:
    """The stop's position, m."""
    stop = scene.parts().stop
    assert not isinstance(stop, NoStop)
    return stop.position_m


def refuse_other_drives(scene: Scene) -> None:
    """A led crank is a motor's that takes its torque at once."""
    if scene.drive.model != "motor":
        raise BadInputError(
            f"scene.drive.model = {scene.drive.model!r}: campaigns lead the crank of a motor that takes its "
            "torque at once; set scene.drive.model = 'motor'"
        )


def goes_on(impacts_s: FloatArray, until_s: float, omega_rad_s: float, judged_s: float = JUDGED_S) -> bool:
    """Whether impacts go on to the end: no gap in the last `judged_s` lasts over `LONGEST_GAP` periods."""
    gap_s = LONGEST_GAP * 2.0 * np.pi / omega_rad_s
    late = impacts_s[impacts_s >= until_s - judged_s]
    edges = np.concatenate([[until_s - judged_s], late, [until_s]])
    return bool(np.max(np.diff(edges)) <= gap_s)


def alone(
    scene: Scene, start: MotionState, from_rad_s: float, to_rad_s: float, ramp_s: float, duration_s: float
) -> FloatArray:
    """Impacts of a crank that is led from one speed to another in `ramp_s`, then held, as in a `Run`."""
    plant = Plant(scene, 0, led(scene.parts()), replace(start, omega_rad_s=from_rad_s))
    if ramp_s > 0.0:
        plant.advance(FLYWHEEL_KG_M2 * (to_rad_s - from_rad_s) / ramp_s, ramp_s)
    plant.advance(0.0, duration_s - ramp_s)
    return np.array(plant.take_impacts(), dtype=np.float64).reshape(-1, len(Impact._fields))


def at(x_m: float, v_m_s: float, crank_rad: float) -> MotionState:
    """A start of a led crank."""
    return MotionState(0.0, x_m, v_m_s, crank_rad, 0.0, Phase.FLIGHT)


@lru_cache(KEPT)
def reference(scene: Scene, omega_rad_s: float, seed: tuple[int, ...]) -> Reference:
    """What the impact attractor of this truth is at this speed; `seed` is of the starts that are tried."""
    more = np.random.default_rng(seed)
    start = at(scene.striker.rest_length_m, 0.0, 0.0)
    until_s = RAMP_S + HELD_S
    impacts = alone(scene, start, SLOWEST * omega_rad_s, omega_rad_s, RAMP_S, until_s)
    times, speeds = impacts[:, IMPACT_TIME], impacts[:, APPROACH]
    if goes_on(times, until_s, omega_rad_s):
        hardest_m_s = float(np.max(speeds[times > until_s - JUDGED_S]))
        return Reference(True, hardest_m_s, float(np.max(speeds)))
    path_m_s = float(np.max(speeds, initial=0.0))
    for _ in range(TRIES):
        lowest_m, highest_m = -0.1, stop_m_of(scene) - scene.striker.rest_length_m
        start = at(
            scene.striker.rest_length_m + float(more.uniform(lowest_m, highest_m)),
            float(more.uniform(-0.8, 0.8)),
            float(more.uniform(0.0, 2.0 * np.pi)),
        )
        impacts = alone(scene, start, omega_rad_s, omega_rad_s, 0.0, HELD_S)
        times, speeds = impacts[:, IMPACT_TIME], impacts[:, APPROACH]
        if goes_on(times, HELD_S, omega_rad_s):
            hardest_m_s = float(np.max(speeds[times > HELD_S - JUDGED_S]))
            return Reference(True, hardest_m_s, max(path_m_s, hardest_m_s))
    return Reference(False, float("nan"), path_m_s)


@lru_cache(KEPT)
def instant_start_captures(scene: Scene, omega_rad_s: float) -> bool:
    """Whether the sampled start ends in impacts where the crank turns at full speed at once."""
    impacts = alone(scene, initial_state(scene), omega_rad_s, omega_rad_s, 0.0, HELD_S)
    return goes_on(impacts[:, IMPACT_TIME], HELD_S, omega_rad_s)


def would_be_lost(scene: Scene, record: FloatArray, omega_rad_s: float) -> bool:
    """Whether a module in the state of a `PlantRecord` ends without impacts if the crank keeps its speed."""
    state = PlantRecord._make(record)
    start = at(state.x_m, state.v_m_s, state.crank_rad)
    impacts = alone(scene, start, omega_rad_s, omega_rad_s, 0.0, HELD_S)
    late = impacts[impacts[:, IMPACT_TIME] > HELD_S - JUDGED_S]
    return len(late) == 0
