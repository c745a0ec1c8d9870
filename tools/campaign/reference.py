"""What the module does without a controller: its crank at a given speed, whatever the load.

That is the campaigns' own motor with an inertia of a planet and no losses: the same parts, so the same
kernels. It answers whether an impact attractor exists at a speed, how hard impacts are on the way up to it,
where an instant start ends, and where a kicked striker would have ended.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import HuntCrossley
from plant_sim.result import MotionState, Phase
from plant_sim.scene import Scene
from plant_sim.sensing import allocate_sensing
from plant_sim.simulation import initial_state
from plant_sim.solvers.memory import APPROACH, IMPACT_TIME, IMPACTS
from tools.campaign import loop
from tools.campaign.plant import Filters, filters, module

FloatArray = NDArray[np.float64]

TICK_S = 1e-3
PLANET_KG_M2 = 1e12
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
    """The same module with a crank that nothing slows."""
    drive = parts.drive
    assert isinstance(drive, MotorDrive)
    return parts._replace(drive=drive._replace(inertia_kg_m2=PLANET_KG_M2, viscous_n_m_s=0.0, dry_n_m=0.0))


def goes_on(impacts_s: FloatArray, until_s: float, omega_rad_s: float, judged_s: float = JUDGED_S) -> bool:
    """Whether impacts go on to the end: no gap in the last `judged_s` lasts over `LONGEST_GAP` periods."""
    gap_s = LONGEST_GAP * 2.0 * np.pi / omega_rad_s
    late = impacts_s[impacts_s >= until_s - judged_s]
    edges = np.concatenate([[until_s - judged_s], late, [until_s]])
    return bool(np.max(np.diff(edges)) <= gap_s)


def _filters(scene: Scene, parts: Parts) -> Filters:
    assert scene.sensors is not None
    return filters(allocate_sensing(scene.sensors.models(), 0.0, parts.housing), TICK_S)


def alone(
    scene: Scene, start: MotionState, from_rad_s: float, to_rad_s: float, ramp_s: float, duration_s: float
) -> FloatArray:
    """Impacts of a led crank, columns as in the plant's memory, oldest first."""
    parts = led(scene.parts())
    moving = module(parts, start, 64 + round(40.0 * duration_s))
    loop.run_alone(
        parts,
        _filters(scene, parts),
        moving,
        from_rad_s,
        to_rad_s,
        round(ramp_s / TICK_S),
        round(duration_s / TICK_S),
        TICK_S,
    )
    return moving.memory.impacts[: moving.memory.mode[IMPACTS]]


def stop_m_of(scene: Scene) -> float:
    """Where the soft stop is, m."""
    stop = scene.parts().stop
    assert isinstance(stop, HuntCrossley)
    return stop.position_m


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


def would_be_lost(scene: Scene, state: FloatArray, omega_rad_s: float) -> bool:
    """Whether a striker left in this state ends without impacts where the crank keeps its speed."""
    stop_m = stop_m_of(scene)
    start = at(float(state[0]) + stop_m, float(state[1]), float(state[2]))
    impacts = alone(scene, start, omega_rad_s, omega_rad_s, 0.0, HELD_S)
    late = impacts[impacts[:, IMPACT_TIME] > HELD_S - JUDGED_S]
    return len(late) == 0
