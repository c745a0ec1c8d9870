"""Event location that cannot miss a root: proofs of absence first, Newton's method last.

A guard g < 0 is known at one instant with its first derivatives and a bound M on the next one. By Taylor's
theorem

    g(s) ≤ g + g' s + g'' s²/2 + g''' s³/6 + M s⁴/24

within the validity of M, so g has no root before the right-hand side has one. Steps of that length converge
to a root from the left at high order, and pass a near miss without a false root.
"""

import math

from plant_sim.kernels import jit, subroutine

_TRIALS = 4
_GOOD = 0.8
_NEWTON_STEPS = 30
_CHORD_STEPS = 3


@subroutine
def clear_span(
    g: float,
    slope: float,
    bend: float,
    third: float,
    fourth: float,
    fourth_bound: float,
    fifth_bound: float,
    limit: float,
) -> float:
    """Length of a span in [0, limit] in which the guard g ≤ 0 provably has no root after its start.

    `slope` to `fourth` are g' to g'''' at the start; the bounds are those of g'''' and g''''' up to `limit`.
    """
    # A constant B up to `critical` in g + g' s + B s²/2 leaves no root at all.
    if slope <= 0.0:
        critical = 0.0
    elif g < 0.0:
        critical = 0.5 * slope * (slope / g)
    else:
        return 0.0
    clear = 0.0
    linear = third / 3.0
    if bend <= critical:
        clear = _positive_root(fourth_bound / 12.0, linear, bend - critical, limit)
        if clear >= limit:
            return limit
    trial = min(limit, _first_root(g, slope, bend, limit))
    for _ in range(_TRIALS):
        # Up to `trial` g(s) ≤ g + g' s + B(s) s²/2 with B(s) = g'' + g''' s/3 + M s²/12, M the lesser of
        # the bound on g'''' and g'''' + |g'''''| s/5. With M ≥ 0, B is largest at one end of the trial.
        square = max(0.0, min(fourth_bound, fourth + 0.2 * fifth_bound * trial)) / 12.0
        reach = _first_root(g, slope, max(bend, bend + (linear + square * trial) * trial), limit)
        if reach >= trial:
            return max(clear, trial)
        clear = max(clear, reach)
        if clear > _GOOD * trial:
            return clear
        trial = 0.5 * (clear + trial)
    return clear


@subroutine
def _positive_root(square: float, linear: float, constant: float, limit: float) -> float:
    """Root in s > 0 of square s² + linear s + constant, square ≥ 0 ≥ constant; `limit` if there is none."""
    root = math.sqrt(linear * linear - 4.0 * square * constant)
    if linear > 0.0:
        return min(limit, -2.0 * constant / (linear + root))
    if square > 0.0:
        return min(limit, (root - linear) / (2.0 * square))
    return limit


@subroutine
def _first_root(g: float, slope: float, bend: float, limit: float) -> float:
    """First root in s > 0 of g + slope s + bend s²/2 with g ≤ 0; `limit` if there is none."""
    discriminant = slope * slope - 2.0 * bend * g
    if discriminant < 0.0:
        return limit
    root = math.sqrt(discriminant)
    if slope > 0.0:
        return -2.0 * g / (slope + root)
    if bend > 0.0:
        return (root - slope) / bend
    return limit


@subroutine
def polish(
    g: float, slope: float, bend: float, third: float, fourth: float, fifth: float, start: float, limit: float
) -> float:
    """Root up to `limit` of the Taylor polynomial by Newton's method from `start`; −1 if it finds none."""
    s = start
    for _ in range(_NEWTON_STEPS):
        value = g + s * (slope + s * (bend / 2 + s * (third / 6 + s * (fourth / 24 + s * fifth / 120))))
        rate = slope + s * (bend + s * (third / 2 + s * (fourth / 6 + s * fifth / 24)))
        if value == 0.0:
            return s
        if not rate > 0.0:
            return -1.0
        step = value / rate
        s -= step
        if not 0.0 <= s <= limit:
            return -1.0
        if abs(step) <= 1e-9 * s:  # Newton squares it
            return s
    return s


@jit
def guess_between(g: float, slope: float, end: float, end_slope: float, span: float) -> float:
    """Estimate of the root of a guard in a span from its values at both ends: a root of Hermite's cubic.

    Newton's method starts from the same cubic for the inverse and then needs one step, or from the chord.
    """
    rise = end - g
    u = -g / rise
    mean = rise / span
    steps = _CHORD_STEPS
    if slope > 0.0 and end_slope > 0.0:
        steps = 1
        u += u * (1.0 - u) * ((1.0 - u) * (mean / slope - 1.0) - u * (mean / end_slope - 1.0))
    first, second = slope * span, (3.0 * mean - 2.0 * slope - end_slope) * span
    third = rise - first - second
    for _ in range(steps):
        u = min(max(u, 0.0), 1.0)
        rate = first + u * (2.0 * second + u * 3.0 * third)
        if rate > 0.0:
            u -= (g + u * (first + u * (second + u * third))) / rate
    return min(max(u, 0.0), 1.0) * span


@jit
def near_root(g: float, slope: float, bend: float, third: float, fourth: float) -> float:
    """Distance to a close root of a nearly linear Taylor polynomial.

    The reversed series (Abramowitz & Stegun 3.6.25) in r = −g / slope; for |bend r| ≤ slope / 1000 its
    remainder is below 1e-12 of r.
    """
    per_slope = 1.0 / slope
    r = -g * per_slope
    b, c, d = bend / 2 * per_slope, third / 6 * per_slope, fourth / 24 * per_slope
    return r + r * r * (-b + r * ((2.0 * b * b - c) + r * (5.0 * b * (c - b * b) - d)))
