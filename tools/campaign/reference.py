"""The module without a controller: its crank has a prescribed speed under any load.

The reference is the plant with a motor that has a very large flywheel and no losses, so that it uses the same
parts and kernels. It determines whether an impact attractor exists at a speed, the largest v⁻ of a slow
run-up to this speed, the regime at the end of an instant start, and the regime after a kick.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import FloatArray, record_type
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop
from plant_sim.plant import Plant
from plant_sim.result import Impact, MotionState, Phase
from plant_sim.scene import Scene
from plant_sim.simulation import initial_state
from tools.output import BadInputError

FLYWHEEL_KG_M2 = 1e4
"""Flywheel's inertia; a mean load below 0.1 N m changes its speed by less than 0.001 rad/s in a minute."""
ACCURACY_M = 1e-6
"""Error of position per forcing period: regimes are those of 1e-9 m, and v⁻ changes by less than 1e-5 m/s."""
FLYWHEEL_V = 1e9
"""Supply voltage, above the back-EMF of a motor whose torque constant suits the flywheel."""
RAMP_S, HELD_S = 40.0, 20.0
"""Durations, s: of the run-up, so slow that the striker follows its attractor, and of the hold, long enough
for the striker to leave an attractor that is not stable."""
SLOWEST = 0.4
"""Initial speed of the slow run-up as a share of the final speed; there are no impacts at this speed."""
LONGEST_GAP = 2.2
"""Longest time between two impacts of lasting impact motion, in periods; some orbits last two periods."""
JUDGED_S = 8.0
"""Length of the last part of a run, which decides whether impacts last: twelve periods."""
KEPT = 2048
"""Number of cached results; a tuning evaluates many candidates on the same truths."""
TRIES = 12
"""Number of random initial states at full speed that are tried if the slow run-up has lost the attractor."""


class Reference(NamedTuple):
    """Whether impacts last at the speed, their largest v⁻, and the largest v⁻ of the slow run-up, m/s."""

    exists: bool
    hardest_m_s: float
    path_m_s: float


def lead_crank(parts: Parts) -> Parts:
    """Return the parts with a flywheel that prescribes the crank's speed and a motor that can turn it."""
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


def refuse_other_drives(scene: Scene) -> None:
    """Raise BadInputError unless the drive is a motor whose torque follows its command without delay."""
    if scene.drive.model != "motor":
        raise BadInputError(
            f"scene.drive.model = {scene.drive.model!r}: campaigns lead the crank of a motor that takes its "
            "torque at once; set scene.drive.model = 'motor'"
        )


def goes_on(impacts_s: FloatArray, until_s: float, omega_rad_s: float, judged_s: float = JUDGED_S) -> bool:
    """Return whether impacts last to the end.

    They do if there are some in the last `judged_s`, without a gap of more than `LONGEST_GAP` periods.
    """
    from_s = until_s - judged_s
    has_impact = bool(np.any((impacts_s > from_s) & (impacts_s < until_s)))
    return has_impact and len(long_gaps(impacts_s, from_s, until_s, 2.0 * np.pi / omega_rad_s)) == 0


def long_gaps(impacts_s: FloatArray, from_s: float, until_s: float, period_s: float) -> FloatArray:
    """Return the intervals, shape (n, 2), of more than `LONGEST_GAP` periods without impacts."""
    inside = impacts_s[(impacts_s > from_s) & (impacts_s < until_s)]
    edges = np.concatenate([[from_s], inside, [until_s]])
    begins = np.flatnonzero(np.diff(edges) > LONGEST_GAP * period_s)
    return np.column_stack((edges[begins], edges[begins + 1]))


def simulate_alone(
    scene: Scene, start: MotionState, from_rad_s: float, to_rad_s: float, ramp_s: float, duration_s: float
) -> NDArray[np.void]:
    """Return the impacts, as records of `Impact`, while the crank's speed ramps up and is then held.

    The speed goes from `from_rad_s` to `to_rad_s` in `ramp_s`; the whole run lasts `duration_s`.
    """
    solver = scene.solver.model_copy(update={"accuracy": ACCURACY_M})
    unsensed = scene.model_copy(update={"sensors": None, "solver": solver})
    plant = Plant(unsensed, 0, lead_crank(scene.parts()), replace(start, omega_rad_s=from_rad_s))
    if ramp_s > 0.0:
        plant.advance(FLYWHEEL_KG_M2 * (to_rad_s - from_rad_s) / ramp_s, ramp_s)
    plant.advance(0.0, duration_s - ramp_s)
    return np.array(plant.take_impacts(), record_type(Impact))


def state_at(x_m: float, v_m_s: float, crank_rad: float) -> MotionState:
    """Return an initial state at t = 0 in flight."""
    return MotionState(0.0, x_m, v_m_s, crank_rad, 0.0, Phase.FLIGHT)


def hardest_m_s(impacts: NDArray[np.void], until_s: float) -> float:
    """Return the largest v⁻ in the last part of a run, m/s."""
    return float(np.max(impacts["v_m_s"][impacts["t_s"] > until_s - JUDGED_S]))


@lru_cache(KEPT)
def reference(scene: Scene, omega_rad_s: float, seed: tuple[int, ...]) -> Reference:
    """Return the reference of this truth at this speed; `seed` generates the tried initial states."""
    more = np.random.default_rng(seed)
    start = state_at(scene.striker.rest_length_m, 0.0, 0.0)
    until_s = RAMP_S + HELD_S
    impacts = simulate_alone(scene, start, SLOWEST * omega_rad_s, omega_rad_s, RAMP_S, until_s)
    path_m_s = float(np.max(impacts["v_m_s"], initial=0.0))
    if goes_on(impacts["t_s"], until_s, omega_rad_s):
        return Reference(True, hardest_m_s(impacts, until_s), path_m_s)
    stop = scene.parts().stop
    assert not isinstance(stop, NoStop)
    lowest_m, highest_m = -0.1, stop.position_m - scene.striker.rest_length_m
    for _ in range(TRIES):
        start = state_at(
            scene.striker.rest_length_m + float(more.uniform(lowest_m, highest_m)),
            float(more.uniform(-0.8, 0.8)),
            float(more.uniform(0.0, 2.0 * np.pi)),
        )
        impacts = simulate_alone(scene, start, omega_rad_s, omega_rad_s, 0.0, HELD_S)
        if goes_on(impacts["t_s"], HELD_S, omega_rad_s):
            late_m_s = hardest_m_s(impacts, HELD_S)
            return Reference(True, late_m_s, max(path_m_s, late_m_s))
    return Reference(False, float("nan"), path_m_s)


@lru_cache(KEPT)
def instant_start_captures(scene: Scene, omega_rad_s: float) -> bool:
    """Return whether the sampled initial state leads to lasting impacts if the crank starts at full speed."""
    impacts = simulate_alone(scene, initial_state(scene), omega_rad_s, omega_rad_s, 0.0, HELD_S)
    return goes_on(impacts["t_s"], HELD_S, omega_rad_s)


def would_be_lost(scene: Scene, start: MotionState, omega_rad_s: float) -> bool:
    """Return whether a state leads to motion without impacts at constant crank speed."""
    impacts = simulate_alone(scene, start, omega_rad_s, omega_rad_s, 0.0, HELD_S)
    return not np.any(impacts["t_s"] > HELD_S - JUDGED_S)
