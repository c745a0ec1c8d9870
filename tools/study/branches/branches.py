"""Branches of periodic impact orbits over one parameter, stable and unstable, with their special points.

| kind | where | test that changes its sign |
|---|---|---|
| fold | two orbits, one of them unstable, meet and vanish | the parameter's share of the tangent |
| period-doubling | a multiplier is −1 | Π (1 + multiplier) |
| grazing | v⁻ = 0, or a touch between two impacts; the branch ends | v⁻, clearance |
| stick | a turn of dry friction begins or ceases to hold the striker | least margin of a turn |

A branch also ends at the limits of its parameter (`parameters.PARAMETERS`).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, pairwise

import numpy as np
from scipy.linalg import svd

from plant_sim.scene import Scene
from tools.study.branches.attractors import seeds
from tools.study.branches.continuation import CurvePoint, Vector, correct, follow, locate, point_at
from tools.study.branches.impact_map import ImpactMap, Orbit
from tools.study.branches.parameters import PARAMETERS, TURN_RAD

LONGEST_STEP = 0.05
MOST_POINTS = 2000
SLOW = 1e-3
"""v⁻ over the scale of speed below which a branch that cannot be followed on ends by grazing."""
ZERO = 1e-6
"""Largest value of a test at its root; at a pole, such as a multiplier's at grazing, it is larger."""
BESIDE = 1e-5
"""Distance, in the scaled parameter, of a seed from the grazing where the orbit has lost an impact."""
SAME = 2e-2
"""Distance, in scaled unknowns, up to which a seed lies on a branch that is interpolated linearly."""


@dataclass(frozen=True)
class Special:
    """A special point of a branch; `ends` says whether the branch ends there."""

    kind: str
    orbit: Orbit
    ends: bool

    @property
    def doubles(self) -> bool:
        """Whether the branch begins or ends here at the period doubling of an orbit of half as many turns."""
        return self.kind == "period-doubling" and self.ends


@dataclass
class Branch:
    """Orbits in the order of the curve, special ones included."""

    turns: int
    impacts: int
    over: str
    orbits: list[Orbit] = field(default_factory=list)
    special: list[Special] = field(default_factory=list)
    curve: list[CurvePoint] = field(default_factory=list)
    operating: list[Orbit] = field(default_factory=list)
    """Orbits at the scene's own value of the parameter; they are among `orbits` too."""

    def neighbours(self, orbit: Orbit) -> list[Special]:
        """The ends of the motion next to one of the orbits along the curve, at most one on each side.

        Where dry friction begins to hold the striker the motion does not end.
        """
        special = {id(one.orbit): one for one in self.special if one.kind != "stick"}
        index = next(place for place, one in enumerate(self.orbits) if one is orbit)
        sides = (reversed(self.orbits[:index]), iter(self.orbits[index + 1 :]))
        met = (next((special[id(one)] for one in side if id(one) in special), None) for side in sides)
        return [one for one in met if one is not None]


def branches(scene: Scene, over: str, turns: int = 1, impacts: int = 1) -> list[Branch]:
    """The branches over one parameter: from attractors among the seeds, from period doublings of orbits with
    half as many turns and impacts, and from orbits that such a doubling leads to and that lose an impact by
    grazing."""
    module = ImpactMap(scene, turns, impacts, (over,))
    doubled: list[CurvePoint] = []
    if turns % 2 == 0 and impacts % 2 == 0:
        parents = branches(scene, over, turns // 2, impacts // 2)
        special = [one for parent in parents for one in parent.special if one.kind == "period-doubling"]
        doubled = [_double(module, one.orbit) for one in special if not one.doubles]
    found: list[Branch] = []
    for start in doubled:
        if not any(_lies_on(module, branch, start.at) for branch in found):
            branch = _join(module, Branch(turns, impacts, over, curve=[start]), _half(module, start, doubled))
            branch.special.insert(0, Special("period-doubling", branch.orbits[0], True))
            found.append(branch)
    for seed in chain(seeds(module, over), _less_an_impact(module)):
        if not any(_lies_on(module, branch, seed) for branch in found):
            through = _branch_through(module, seed, doubled)
            if through is not None:
                found.append(through)
    return found


def _double(module: ImpactMap, orbit: Orbit) -> CurvePoint:
    """An orbit at its period doubling, passed twice, with the tangent of the branch of twice the period.

    The derivative of the equations has two null vectors there. One repeats in both halves the change of the
    orbit along its own branch; the other, the tangent, changes the halves in opposite directions.
    """
    impacts = 2 * module.impacts
    crank_rad = np.append(orbit.crank_rad, orbit.crank_rad + 0.5 * TURN_RAD * module.turns)
    at = module.point(crank_rad, np.tile(orbit.v_m_s, 2), orbit.values)
    null_vectors = svd(module(at)[1])[2][-2:]
    exchanged = np.hstack((np.roll(null_vectors[:, :impacts], module.impacts, 1), null_vectors[:, impacts:]))
    tangent = max(null_vectors - exchanged, key=np.linalg.norm)
    return CurvePoint(at, tangent / np.linalg.norm(tangent))


def _less_an_impact(module: ImpactMap) -> Iterator[Vector]:
    """Orbits beside those with one more impact at the grazing where that impact ends."""
    if module.turns % 2 == 0 and module.impacts % 2 == 1:
        for branch in branches(module.scene, module.over[0], module.turns, module.impacts + 1):
            for special in branch.special:
                orbit = special.orbit
                if special.kind == "grazing" and np.min(orbit.v_m_s) < ZERO:
                    kept = np.arange(len(orbit.v_m_s)) != np.argmin(orbit.v_m_s)
                    touching = module.point(orbit.crank_rad[kept], orbit.v_m_s[kept], orbit.values)
                    beside = BESIDE * np.eye(len(touching))[-1]
                    yield from (touching - beside, touching + beside)


def _branch_through(module: ImpactMap, seed: Vector, doubled: list[CurvePoint]) -> Branch | None:
    """The whole branch through an orbit; None if the seed converges to no admissible orbit."""
    onward = np.eye(len(seed))[-1]
    corrected = correct(module, seed, onward)
    start = None if corrected is None else point_at(module, corrected, onward)
    if start is None or not module.orbit(start.at).is_admissible:
        return None
    halves = [_half(module, CurvePoint(start.at, sign * start.tangent), doubled) for sign in (-1.0, 1.0)]
    return _join(module, *halves)


def _join(module: ImpactMap, before: Branch, behind: Branch) -> Branch:
    """One branch of the two parts before and behind their common start."""
    turned = [CurvePoint(point.at, -point.tangent) for point in reversed(before.curve[1:])]
    branch = Branch(module.turns, module.impacts, module.over[0], curve=turned + behind.curve)
    branch.orbits = [module.orbit(point.at) for point in branch.curve]
    branch.special = before.special[::-1] + behind.special
    start = module.orbit(behind.curve[0].at)
    at_nominal = [start] if behind.curve[0].at[-1] == _nominal(module) else []
    branch.operating = before.operating[::-1] + at_nominal + behind.operating
    return branch


def _nominal(module: ImpactMap) -> float:
    """The scene's own value of the parameter, scaled."""
    name = module.over[0]
    return module.nominal[name] / PARAMETERS[name].scale


def _lies_on(module: ImpactMap, branch: Branch, z: Vector) -> bool:
    """Whether a branch passes a point."""
    for one, other in pairwise(branch.curve):
        low, high = one.at[-1], other.at[-1]
        if min(low, high) <= z[-1] <= max(low, high) and low != high:
            there = one.at + (z[-1] - low) / (high - low) * (other.at - one.at)
            if np.max(np.abs(_nearest(module, z, there) - there)) < SAME:
                return True
    return False


def _nearest(module: ImpactMap, z: Vector, to: Vector) -> Vector:
    """The point of the same orbit nearest to another point: it may begin at any impact, in any turn."""
    m, same = module.impacts, []
    for first in range(m):
        rolled = np.append(np.roll(z[: 2 * m], -2 * first), z[2 * m :])
        rolled[2 * (m - first) : 2 * m : 2] += TURN_RAD * module.turns
        rolled[0 : 2 * m : 2] += TURN_RAD * round((to[0] - rolled[0]) / TURN_RAD)
        same.append(rolled)
    return min(same, key=lambda one: float(np.max(np.abs(one - to))))


def _half(module: ImpactMap, start: CurvePoint, doubled: list[CurvePoint]) -> Branch:
    """The part of a branch behind a start, up to its end; `doubled`: period doublings where it can end."""
    nominal = _nominal(module)
    half = Branch(module.turns, module.impacts, module.over[0], curve=[start])

    def from_nominal(point: CurvePoint) -> float:
        return float(point.at[-1]) - nominal

    for ahead in follow(module, start, LONGEST_STEP, MOST_POINTS):
        last = half.curve[-1]
        limit = _limit_between(module, last, ahead)
        following = ahead if limit is None else limit
        end = _meet(module, last, following, doubled)
        if end is not None:
            half.curve.append(end)
            half.special.append(Special("period-doubling", module.orbit(end.at), True))
            return half
        between = _special_between(module, half, last, following)
        if from_nominal(last) * from_nominal(following) < 0.0:
            operating = locate(module, last, following, from_nominal)
            if operating is not None and module.orbit(operating.at).is_admissible:
                between.append(operating)
                half.operating.append(module.orbit(operating.at))
        half.curve += sorted(between, key=partial(_arclength, last))
        if not module.orbit(following.at).is_admissible:
            _end(module, half, following)
            return half
        half.curve.append(following)
        if limit is not None or _is_closed(half.curve):
            return half
    _end(module, half, half.curve[-1])
    return half


def _arclength(start: CurvePoint, point: CurvePoint) -> float:
    return float(start.tangent @ (point.at - start.at))


def _limit_between(module: ImpactMap, before: CurvePoint, following: CurvePoint) -> CurvePoint | None:
    """The point between two neighbours of a curve at which the parameter reaches an end of its range."""
    parameter = PARAMETERS[module.over[0]]
    limit = (parameter.low if following.at[-1] < before.at[-1] else parameter.high) / parameter.scale
    if (before.at[-1] - limit) * (following.at[-1] - limit) < 0.0:
        return locate(module, before, following, lambda point: float(point.at[-1]) - limit)
    return None


def _meet(
    module: ImpactMap, before: CurvePoint, following: CurvePoint, doubled: list[CurvePoint]
) -> CurvePoint | None:
    """The period doubling between two neighbours of a curve, where the parameter turns round."""
    if _fold(module, before) * _fold(module, following) < 0.0:
        for one in doubled:
            there = CurvePoint(_nearest(module, one.at, before.at), before.tangent)
            share = _arclength(before, there) / _arclength(before, following)
            passed = before.at + share * (following.at - before.at)
            if 0.0 < share < 1.0 and np.max(np.abs(there.at - passed)) < SAME:
                return there
    return None


def _special_between(
    module: ImpactMap, half: Branch, before: CurvePoint, following: CurvePoint
) -> list[CurvePoint]:
    """Locate the special points between two neighbours of a curve."""
    found = []
    for kind, test in TESTS.items():
        if test(module, before) * test(module, following) < 0.0:
            point = locate(module, before, following, partial(test, module))
            if point is not None and abs(test(module, point)) < ZERO:
                orbit = module.orbit(point.at)
                # What grazes, or lies beyond the grazing, which ends the branch, is no orbit of it.
                if np.all(np.isfinite(orbit.multipliers)) and orbit.is_admissible:
                    found.append(point)
                    half.special.append(Special(kind, orbit, False))
    return found


def _end(module: ImpactMap, half: Branch, beyond: CurvePoint) -> None:
    """Add the grazing that ends a branch within the parameter's range, before or near `beyond`."""
    last = half.curve[-1]
    slowest = 2 * int(np.argmin(beyond.at[1 : 2 * module.impacts : 2])) + 1
    end = None
    if beyond.at[slowest] < SLOW:
        # v⁻ = 0 is a plane; a curve of dry friction has a kink there and cannot be followed beyond it.
        normal = np.eye(len(last.at))[slowest]
        share = last.at[slowest] / last.tangent[slowest]
        found = correct(module, last.at - share * last.tangent, normal)
        end = None if found is None else point_at(module, found, last.tangent)
    elif beyond is not last:
        end = locate(module, last, beyond, lambda point: module.orbit(point.at).clearance_m)
    parameter = PARAMETERS[module.over[0]]
    if end is not None and parameter.low + ZERO < end.at[-1] * parameter.scale < parameter.high - ZERO:
        half.curve.append(end)
        half.special.append(Special("grazing", module.orbit(end.at), True))


def _is_closed(curve: list[CurvePoint]) -> bool:
    """Whether a curve has left its start and come back to it."""
    start, here = curve[0], curve[-1]
    near = np.max(np.abs(here.at - start.at)) < 0.5 * LONGEST_STEP
    if not near or here.tangent @ start.tangent < 0.9:
        return False
    return any(np.max(np.abs(point.at - start.at)) > LONGEST_STEP for point in curve)


def _fold(module: ImpactMap, point: CurvePoint) -> float:
    return float(point.tangent[-1])


def flip_test(orbit: Orbit) -> float:
    """Π (1 + multiplier), zero at a period doubling; ∞ where a multiplier is infinite, at grazing."""
    multipliers = orbit.multipliers
    return float(np.prod(1.0 + multipliers).real) if np.all(np.isfinite(multipliers)) else math.inf


def _period_doubling(module: ImpactMap, point: CurvePoint) -> float:
    return flip_test(module.orbit(point.at))


def _stick(module: ImpactMap, point: CurvePoint) -> float:
    return min(module.orbit(point.at).margin_m / module.length_m, 1.0)


TESTS: dict[str, Callable[[ImpactMap, CurvePoint], float]] = {
    "fold": _fold,
    "period-doubling": _period_doubling,
    "stick": _stick,
}
