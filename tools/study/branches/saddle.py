"""The points that a map of starts is marked with: its attractors and its unstable orbit, at crank angle 0.

The unstable orbit is a saddle of the map from turn to turn. The border between the starts that end in impacts
and those that do not is its stable manifold, so that it lies on this border.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.scene import Scene
from tools.study.branches.branches import branches
from tools.study.branches.impact_map import Orbit
from tools.study.branches.parameters import TURN_RAD, value_in, with_values
from tools.study.orbits import AT_REST, State, end_of, motion, scale_m_s, turn_s

ACCURACY_M = 1e-10
"""Of the adaptive solver, per period."""
FAR, SETTLED_TURNS, SETTLED = 10.0, 400, 1e-6
"""Gap, over the scene's own, that the motion without impacts is clear of; turns and relative distance of
settling."""


class Portrait(NamedTuple):
    """Points (y in m, v in m/s) at crank angle 0, each of shape (n, 2).

    `attractors`: stable impact orbits and the steady motion without impacts. `saddles`: unstable orbits.
    """

    attractors: NDArray[np.float64]
    saddles: NDArray[np.float64]


def portrait(scene: Scene) -> Portrait:
    """The attractors and the saddles of a scene with a rigid stop, for a map of its starts."""
    orbits = [orbit for branch in branches(scene, "ratio") for orbit in branch.operating]
    stable, unstable = (
        [point_of(scene, orbit) for orbit in orbits if orbit.is_stable == is_stable]
        for is_stable in (True, False)
    )
    return Portrait(*(np.array(some).reshape(-1, 2) for some in (stable + swing(scene), unstable)))


def after(scene: Scene, start: State, turns: float) -> State:
    """The state of a start after a number of turns of the crank."""
    return end_of(scene, motion(scene, start, turns * turn_s(scene), accuracy_m=ACCURACY_M))


def point_of(scene: Scene, orbit: Orbit) -> tuple[float, float]:
    """The point of an orbit at crank angle 0: from its last impact on."""
    crank_rad = float(orbit.crank_rad[-1] % TURN_RAD)
    rebound_m_s = -value_in(scene, "restitution") * float(orbit.v_m_s[-1])
    start = State(value_in(scene, "gap"), rebound_m_s, crank_rad)
    return after(scene, start, (TURN_RAD - crank_rad) / TURN_RAD)[:2]


def swing(scene: Scene) -> list[tuple[float, float]]:
    """The steady motion without impacts, in which a start at rest ends; none if it reaches the stop."""
    settled = after(with_values(scene, {"gap": FAR * value_in(scene, "gap")}), AT_REST, SETTLED_TURNS)
    moved = np.subtract(after(scene, settled, 1.0), settled)[:2] * (scene.natural_rad_s, 1.0)
    return [settled[:2]] if np.max(np.abs(moved)) < SETTLED * scale_m_s(scene) else []
