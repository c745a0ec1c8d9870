"""Boundaries of the impact regime in two parameters: folds, period doublings and grazing, continued.

A boundary is a curve of orbits that fulfil one more equation: a singular derivative of the orbit's equations
(fold), Π (1 + multiplier) = 0 (period doubling), v⁻ = 0 of an impact or no clearance between impacts
(grazing). Each starts at a special point of a branch over the first parameter.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.scene import Scene
from tools.study.branches.branches import Branch, Special, branches, flip_test
from tools.study.branches.continuation import CurvePoint, Vector, correct, follow, point_at
from tools.study.branches.impact_map import ImpactMap, Orbit
from tools.study.branches.parameters import PARAMETERS, value_in

LONGEST_STEP = 0.1
MOST_POINTS = 400
DIFFERENCE = 1e-5
"""Step of the condition's differences, in scaled unknowns; Newton's method corrects for their error."""
SAME = 0.01
"""Distance in the first parameter over its scale, up to which an interpolated boundary passes an orbit."""
GRAZED = 1e-6
"""v⁻ over the scale of speed of an impact that grazes."""


@dataclass(frozen=True)
class Boundary:
    """A curve of special orbits in the plane of two parameters, in the order of the curve."""

    kind: str
    over: tuple[str, str]
    turns: int
    orbits: list[Orbit]

    def values(self, name: str) -> NDArray[np.float64]:
        """One parameter along the curve."""
        return np.array([orbit.values[name] for orbit in self.orbits])


class Margin(NamedTuple):
    """Distance from the scene's own value of a parameter to the special point that is met first."""

    kind: str
    parameter: str
    unit: str
    at: float
    distance: float


class Condition:
    """The orbit's equations and the one more that holds on a boundary (`continuation.System`)."""

    def __init__(self, module: ImpactMap, special: Special) -> None:
        self.module, self.kind = module, special.kind
        slowest = int(np.argmin(special.orbit.v_m_s))
        self.grazed = None
        if self.kind == "grazing" and special.orbit.v_m_s[slowest] < GRAZED * module.speed_m_s:
            self.grazed = 2 * slowest + 1

    def value(self, z: Vector) -> float:
        """The left side of the further equation, scaled."""
        if self.grazed is not None:
            return float(z[self.grazed])
        if self.kind == "fold":
            with np.errstate(invalid="ignore"):  # nan where a flight would end before its start
                return float(np.linalg.det(self.module.equations(z)[1]))
        orbit = self.module.orbit(z)
        if self.kind == "period-doubling":
            return flip_test(orbit)
        return orbit.clearance_m / self.module.length_m

    def __call__(self, z: Vector) -> tuple[Vector, NDArray[np.float64]]:
        """Residual, shape (2 m + 1,), and its derivative, shape (2 m + 1, 2 m + 2)."""
        residual, slope = self.module(z)
        value, steps = self.value(z), DIFFERENCE * np.eye(len(z))
        row = [(self.value(z + step) - value) / DIFFERENCE for step in steps]
        return np.append(residual, value), np.vstack((slope, row))


def boundaries(scene: Scene, over: tuple[str, str], found: list[Branch]) -> list[Boundary]:
    """The boundaries through the special points of branches over the first of two parameters.

    Boundaries of a soft stop need many simulations and take a minute.
    """
    curves: list[Boundary] = []
    for branch in found:
        module = ImpactMap(scene, branch.turns, branch.impacts, over)
        for special in branch.special:
            continued = special.kind != "stick" and not special.doubles
            if continued and not any(_passes(curve, special, scene) for curve in curves):
                curve = boundary_through(module, special)
                if curve is not None:
                    curves.append(curve)
    return curves


def _passes(curve: Boundary, special: Special, scene: Scene) -> bool:
    """Whether a boundary passes a special orbit at the scene's own value of the second parameter."""
    first, second = curve.over
    nominal, there = value_in(scene, second), special.orbit.values[first]
    for one, other in pairwise(curve.orbits):
        low, high = one.values[second], other.values[second]
        if curve.kind == special.kind and low != high and min(low, high) <= nominal <= max(low, high):
            share = (nominal - low) / (high - low)
            passed = one.values[first] + share * (other.values[first] - one.values[first])
            if abs(passed - there) < SAME * PARAMETERS[first].scale:
                return True
    return False


def boundary_through(module: ImpactMap, special: Special) -> Boundary | None:
    """The whole boundary through a special orbit; None if it cannot be continued."""
    condition = Condition(module, special)
    values = {**module.nominal, **special.orbit.values}
    seed = module.point(special.orbit.crank_rad, special.orbit.v_m_s, values)
    corrected = correct(condition, seed)
    start = None if corrected is None else point_at(condition, corrected, np.eye(len(seed))[-1])
    if start is None:
        return None
    halves = [_half(condition, CurvePoint(start.at, sign * start.tangent)) for sign in (-1.0, 1.0)]
    orbits = halves[0][:0:-1] + halves[1]
    return Boundary(special.kind, (module.over[0], module.over[1]), module.turns, orbits)


def _half(condition: Condition, start: CurvePoint) -> list[Orbit]:
    """The boundary behind a start until it leaves the parameters' ranges or its orbits exist no more."""
    module = condition.module
    orbits = [module.orbit(start.at)]
    for point in follow(condition, start, LONGEST_STEP, MOST_POINTS):
        orbit = module.orbit(point.at)
        slowest, clearance = np.min(orbit.v_m_s), orbit.clearance_m
        if slowest < -GRAZED * module.speed_m_s or clearance < -GRAZED * module.length_m:
            break
        if not all(PARAMETERS[name].low < orbit.values[name] < PARAMETERS[name].high for name in module.over):
            break
        orbits.append(orbit)
    return orbits


def margins(scene: Scene, names: tuple[str, ...], turns: int = 1, impacts: int = 1) -> list[Margin]:
    """For each parameter alone: the ends that the scene's stable orbit meets first, on both sides."""
    return [one for name in names for one in margins_on(branches(scene, name, turns, impacts), scene, name)]


def margins_on(found: list[Branch], scene: Scene, name: str) -> list[Margin]:
    """The margins along branches over one parameter."""
    parameter, nominal = PARAMETERS[name], value_in(scene, name)
    special = [
        one
        for branch in found
        for orbit in branch.operating
        if orbit.is_stable
        for one in branch.neighbours(orbit)
    ]
    return [
        Margin(one.kind, name, parameter.unit, one.orbit.values[name], one.orbit.values[name] - nominal)
        for one in special
        if parameter.low < one.orbit.values[name] < parameter.high
    ]
