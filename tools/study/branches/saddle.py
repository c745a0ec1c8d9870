"""The unstable orbit in a map of starts: its point at crank angle 0, its stable manifold, and the attractors.

The stroboscopic map P takes a start (y = x − l0, v) at crank angle 0 to the state one turn later. The
unstable orbit is a saddle of P, and its stable manifold separates the starts that end in impacts from those
that do not. The manifold has a corner wherever a motion from it grazes the stop, and P has no derivative
there. So it is followed from the saddle by simulations alone: on a circle around its last point, a bisection
finds where the starts change their end.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.scene import Scene
from tools.study.branches.branches import branches
from tools.study.branches.continuation import Vector
from tools.study.branches.impact_map import Orbit
from tools.study.branches.parameters import TURN_RAD, value_in, with_values
from tools.study.orbits.follow import State, advance, carrier_of, classify_starts
from tools.study.orbits.sections import CLASSIFY

ACCURACY_M = 1e-10
"""Of the adaptive solver, per period."""
FAR, SETTLED_TURNS, SETTLED = 10.0, 400, 1e-6
"""Gap, over the scene's own, that the motion without impacts is clear of; turns and distance of settling."""
STEP, FARTHEST, MOST_POINTS = 0.02, 1.5, 600
"""Scaled distance between points of the manifold, and largest scaled start; the manifold ends there or at the
stop."""
SHARPEST_RAD, DIRECTIONS, HALVINGS = 0.9 * math.pi, 17, 20
"""Largest turn at a corner, directions that are tried, and halvings of the interval between two of them."""


class Portrait(NamedTuple):
    """Points (y in m, v in m/s) at crank angle 0: stable orbits, the saddle, and its stable manifold.

    `attractors`: shape (n, 2), impact orbits and the steady motion without impacts. `saddle`: None without an
    unstable orbit. `manifold`: shape (n, 2), in the order of the curve.
    """

    attractors: NDArray[np.float64]
    saddle: Vector | None
    manifold: NDArray[np.float64]


class Stroboscope:
    """The stroboscopic map of a scene, in unknowns scaled by the gap and by ω times the gap."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.carrier = scene, carrier_of(scene, ACCURACY_M)
        self.gap_m, size = value_in(scene, "gap"), self.carrier.size
        self.scale = np.array([size.length_m, size.speed_m_s])
        self.turn_s = TURN_RAD / size.drive_rad_s

    def after(self, start: Vector, turns: float, crank_rad: float = 0.0) -> Vector:
        """The scaled state (y, v) `turns` turns after a start at a crank angle."""
        y_m, v_m_s = map(float, start * self.scale)
        begun = State(min(y_m, self.gap_m), v_m_s, crank_rad % TURN_RAD)
        state: Vector = np.array(advance(self.carrier, begun, turns * self.turn_s)[:2]) / self.scale
        return state

    def end_in_impacts(self, starts: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether scaled starts (y, v) at crank angle 0, shape (n, 2), end in impacts."""
        begun = np.zeros((len(starts), 3))
        begun[:, :2] = starts * self.scale
        begun[:, 0] = np.minimum(begun[:, 0], self.gap_m)
        return classify_starts(self.carrier, begun, CLASSIFY)[1] > 0.0

    def point_of(self, orbit: Orbit) -> Vector:
        """The point of an orbit at crank angle 0."""
        crank_rad = float(orbit.crank_rad[-1] % TURN_RAD)
        rebound = -value_in(self.scene, "restitution") * float(orbit.v_m_s[-1])
        start = np.array([self.gap_m, rebound]) / self.scale
        return self.after(start, (TURN_RAD - crank_rad) / TURN_RAD, crank_rad)


def portrait(scene: Scene) -> Portrait:
    """The attractors and the saddle of a scene with a rigid stop, for a map of its starts."""
    map_of_turns = Stroboscope(scene)
    orbits = [orbit for branch in branches(scene, "ratio") for orbit in branch.operating]
    points = [map_of_turns.point_of(orbit) for orbit in orbits if orbit.is_stable]
    points += swing(map_of_turns)
    saddles = [map_of_turns.point_of(orbit) for orbit in orbits if not orbit.is_stable]
    manifold = _manifold(map_of_turns, saddles[0]) if saddles else np.zeros((0, 2))
    return Portrait(
        np.array(points).reshape(-1, 2) * map_of_turns.scale,
        saddles[0] * map_of_turns.scale if saddles else None,
        manifold * map_of_turns.scale,
    )


def swing(map_of_turns: Stroboscope) -> list[Vector]:
    """The steady motion without impacts, in which a start at rest ends; none if it reaches the stop."""
    far = Stroboscope(with_values(map_of_turns.scene, {"gap": FAR * map_of_turns.gap_m}))
    settled = far.after(np.zeros(2), SETTLED_TURNS) * far.scale / map_of_turns.scale
    returned = map_of_turns.after(settled, 1.0)
    return [settled] if np.max(np.abs(returned - settled)) < SETTLED else []


def _manifold(map_of_turns: Stroboscope, saddle: Vector) -> NDArray[np.float64]:
    """The stable manifold of a saddle, from one end to the other; empty if it separates no starts."""
    halves = [_half(map_of_turns, saddle, side) for side in (-1.0, 1.0)]
    return np.array(halves[0][:0:-1] + halves[1]).reshape(-1, 2)


def _half(map_of_turns: Stroboscope, saddle: Vector, side: float) -> list[Vector]:
    """The manifold from the saddle on, with impacts to its left (`side` 1) or right (−1)."""
    points, stop = [saddle], map_of_turns.gap_m / map_of_turns.scale[0]
    heading = _heading(map_of_turns, saddle, 0.0, side * math.pi)
    while heading is not None and len(points) < MOST_POINTS:
        following = points[-1] + STEP * np.array([math.cos(heading), math.sin(heading)])
        if np.max(np.abs(following)) > FARTHEST or following[0] > stop:
            break
        points.append(following)
        if len(points) > DIRECTIONS and np.max(np.abs(following - saddle)) < 0.5 * STEP:
            break
        heading = _heading(map_of_turns, following, heading, side * SHARPEST_RAD)
    return points


def _heading(map_of_turns: Stroboscope, at: Vector, heading: float, widest: float) -> float | None:
    """The direction from a point of the manifold to the next, the first from `widest` beside a heading on."""

    def end_in_impacts(angles: NDArray[np.float64]) -> NDArray[np.bool_]:
        around = np.column_stack((np.cos(angles), np.sin(angles)))
        return map_of_turns.end_in_impacts(at + STEP * around)

    angles = heading + np.linspace(widest, -widest, DIRECTIONS)
    in_impacts = end_in_impacts(angles)
    (changes,) = np.nonzero(in_impacts[:-1] & ~in_impacts[1:])
    if len(changes) == 0:
        return None
    inside, outside = angles[changes[0]], angles[changes[0] + 1]
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        if end_in_impacts(np.array([middle]))[0]:
            inside = middle
        else:
            outside = middle
    return float(0.5 * (inside + outside))
