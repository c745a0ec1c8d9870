"""Pseudo-arclength continuation of the zeros of n equations in n + 1 unknowns.

Predictor: along the curve's tangent. Corrector: Newton's method in the plane through the prediction, normal
to the tangent (Keller 1977; Kuznetsov, Elements of Applied Bifurcation Theory, ch. 10). The curve passes
folds, where the parameter turns round, like any other point. numpy solves the linear equations, and scipy
finds null spaces and roots; neither has a continuation.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.linalg import LinAlgError, lstsq, solve
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import brentq

Vector: TypeAlias = NDArray[np.float64]
System: TypeAlias = Callable[[Vector], tuple[Vector, NDArray[np.float64]]]
"""Residual, shape (n,), and its derivative, shape (n, n + 1), at a point of shape (n + 1,)."""

MOST_ITERATIONS = 40
"""Newton's method converges linearly at a kink, where dry friction changes its direction."""
FIRST_STEP, LEAST_STEP = 5e-3, 1e-9
STRAIGHT, STRAIGHTER, GROWTH = 0.95, 0.99, 1.5
"""Least cosine between successive tangents, by more of which a step is halved; above STRAIGHTER the next step
is longer by GROWTH."""
TOLERANCE, CORRECTION = 1e-9, 1e-10
"""Of the residual before the last correction, and of that correction, whose square is what remains; unknowns
and equations are scaled to the order of 1."""


class CurvePoint(NamedTuple):
    """A point of a curve and its unit tangent, both of shape (n + 1,)."""

    at: Vector
    tangent: Vector


def correct(system: System, guess: Vector, normal: Vector | None = None) -> Vector | None:
    """The zero near a guess; None if Newton's method does not converge.

    In the plane through `guess` with this normal; without one, each correction is the shortest possible.
    """
    at = guess.copy()
    for _ in range(MOST_ITERATIONS):
        residual, slope = system(at)
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(slope))):
            return None
        try:
            if normal is None:
                change = lstsq(slope, -residual)[0]
            else:
                right = np.append(-residual, -normal @ (at - guess))
                change = solve(np.vstack((slope, normal)), right)
        except LinAlgError:
            return None
        at = at + change
        if np.max(np.abs(residual)) < TOLERANCE and np.max(np.abs(change)) < CORRECTION:
            return at
    return None


def point_at(system: System, at: Vector, along: Vector) -> CurvePoint | None:
    """The curve's point at a zero, its tangent in the half space of `along`; None where it has no tangent."""
    kernel = null_space(system(at)[1])
    if kernel.shape[1] != 1:
        return None
    tangent = kernel[:, 0]
    return CurvePoint(at, tangent if tangent @ along >= 0.0 else -tangent)


def follow(system: System, start: CurvePoint, longest_step: float, most_points: int) -> Iterator[CurvePoint]:
    """The curve's points behind `start`, along its tangent, until the caller stops or no step converges."""
    here, step = start, min(FIRST_STEP, longest_step)
    for _ in range(most_points):
        following = None
        while following is None:
            at = correct(system, here.at + step * here.tangent, here.tangent)
            following = None if at is None else point_at(system, at, here.tangent)
            if following is not None and following.tangent @ here.tangent < STRAIGHT:
                following = None
            if following is None:
                step *= 0.5
                if step < LEAST_STEP:
                    return
        yield following
        if following.tangent @ here.tangent > STRAIGHTER:
            step = min(GROWTH * step, longest_step)
        here = following


def locate(
    system: System, before: CurvePoint, after: CurvePoint, test: Callable[[CurvePoint], float]
) -> CurvePoint | None:
    """The point between two neighbours of a curve at which `test` changes its sign; None if it is lost.

    Brent's method over the arclength; a test that only has a sign is bisected.
    """
    chord = after.at - before.at
    length = float(before.tangent @ chord)
    tried: dict[float, CurvePoint] = {0.0: before, length: after}

    def value(arclength: float) -> float:
        if arclength not in tried:
            guess = before.at + (arclength / length) * chord
            found = correct(system, guess, before.tangent)
            here = None if found is None else point_at(system, found, before.tangent)
            if here is None:
                return math.nan
            tried[arclength] = here
        return test(tried[arclength])

    try:
        root = brentq(value, 0.0, length, xtol=1e-15, rtol=1e-14)
    except (ValueError, RuntimeError):  # the curve is lost between the two points
        return None
    value(root)
    return tried.get(root)
