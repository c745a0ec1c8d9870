"""Polynomials on [0, 1] in Bernstein form, with root finding that cannot miss a root.

p(s) = Σ b_i C(n, i) sⁱ (1 − s)ⁿ⁻ⁱ lies in the hull of its coefficients and has at most as many roots in
(0, 1) as they have sign changes, with the same parity (Farin, Curves and Surfaces for CAGD, 5th ed. 2002,
chapter 5): no change proves that there is no root, one change brackets exactly one; with more changes the
interval is halved.
"""

import math

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import subroutine

Coefficients = NDArray[np.float64]

DEGREE = 7
"""Degree of the continuous extension of a step of DOP853."""

ORDER = 16
"""Degree of a step that is a Taylor series: at an accuracy of 1e-10, 14, 18 and 20 are no faster."""

NO_ROOT = 2.0
"""Returned if there is no root in [0, 1]."""

DEEPEST_HALVING = 40
"""An excursion narrower than 2⁻⁴⁰ of a step is below rounding: it is no crossing."""


NODES: Coefficients = 0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
"""Interpolation nodes: Chebyshev points of the second kind, with both ends."""


def _basis(s: float) -> list[float]:
    """The Bernstein polynomials at s."""
    return [math.comb(DEGREE, i) * s**i * (1.0 - s) ** (DEGREE - i) for i in range(DEGREE + 1)]


_BINOMIALS: Coefficients = np.array(
    [[float(math.comb(n, i)) for i in range(ORDER + 1)] for n in range(ORDER + 1)]
)

_START, _WIDTH = ORDER + 1, ORDER + 2
"""Columns of the stack of `first_rise` behind the coefficients."""

_FROM_VALUES: Coefficients = np.linalg.inv(np.array([_basis(float(s)) for s in NODES]))


@subroutine
def interpolate(values: Coefficients, b: Coefficients) -> None:
    """Coefficients of the polynomial through `values` at NODES, into `b`."""
    for i in range(DEGREE + 1):
        b[i] = 0.0
        for j in range(DEGREE + 1):
            b[i] += _FROM_VALUES[i, j] * values[j]


@subroutine
def evaluate(b: Coefficients, degree: int, s: float) -> float:
    """p(s)."""
    r = 1.0 - s
    # Σ b_i C(n, i) sⁱ rⁿ⁻ⁱ, by Horner in s with the powers of r folded in.
    value: float = b[0] * r
    power = 1.0
    for i in range(1, degree):
        power *= s
        value = (value + power * _BINOMIALS[degree, i] * b[i]) * r
    value += power * s * b[degree]
    return value


@subroutine
def at(b: Coefficients, s: float) -> float:
    """p(s) of all coefficients."""
    return evaluate(b, b.size - 1, s)


@subroutine
def from_powers(powers: Coefficients, h: float, b: Coefficients, degree: int) -> None:
    """Coefficients of Σ c_k (h s)ᵏ, of degree n = `degree`, into `b`: b_i = Σ C(i, k) / C(n, k) c_k hᵏ."""
    scale = 1.0
    for k in range(degree + 1):
        b[k] = powers[k] * scale / _BINOMIALS[degree, k]
        scale *= h
    for j in range(1, degree + 1):
        for i in range(degree, j - 1, -1):
            b[i] += b[i - 1]


@subroutine
def without_root_at_start(b: Coefficients, degree: int) -> None:
    """Replace p by p(s)/s, of one degree less, in place; p(0) is taken as 0."""
    for i in range(degree):
        b[i] = b[i + 1] * degree / (i + 1)


@subroutine
def first_rise(b: Coefficients, degree: int, stack: Coefficients) -> float:
    """Smallest s in [0, 1] at which p, negative before, reaches 0; NO_ROOT if it never does, or p = 0.

    `stack` is scratch of shape (DEEPEST_HALVING + 2, ORDER + 3): coefficients, start, width.
    """
    if not _reaches_zero(b, degree) or _is_zero(b, degree):
        return NO_ROOT
    top = 0
    for i in range(degree + 1):
        stack[0, i] = b[i]
    stack[0, _START] = 0.0
    stack[0, _WIDTH] = 1.0
    while top >= 0:
        c = stack[top]
        start = c[_START]
        width = c[_WIDTH]
        if not _reaches_zero(c, degree):
            top -= 1
            continue
        if c[0] >= 0.0:
            return float(start)
        if _sign_changes(c, degree) == 1:
            return float(start + width * _only_root(c, degree))
        if top == DEEPEST_HALVING:
            if c[degree] >= 0.0:
                return float(start)
            top -= 1
            continue
        _halve(stack, top, degree)
        top += 1
    return NO_ROOT


@subroutine
def _reaches_zero(b: Coefficients, degree: int) -> bool:
    highest: float = b[0]
    for i in range(1, degree + 1):
        highest = max(highest, b[i])
    return highest >= 0.0


@subroutine
def _is_zero(b: Coefficients, degree: int) -> bool:
    """Whether p = 0 throughout: a quantity that stays on a surface does not cross it."""
    largest = 0.0
    for i in range(degree + 1):
        largest = max(largest, abs(b[i]))
    return largest == 0.0


@subroutine
def _sign_changes(b: Coefficients, degree: int) -> int:
    changes = 0
    for i in range(degree):
        if (b[i] >= 0.0) != (b[i + 1] >= 0.0):
            changes += 1
    return changes


@subroutine
def _halve(stack: Coefficients, top: int, degree: int) -> None:
    """Put the left half of the polynomial on the top of the stack above its right half."""
    right, left = stack[top], stack[top + 1]
    for i in range(degree + 1):
        left[i] = right[0]
        for j in range(degree - i):
            right[j] = 0.5 * (right[j] + right[j + 1])
    width = 0.5 * right[_WIDTH]
    left[_START] = right[_START]
    left[_WIDTH] = width
    right[_START] += width
    right[_WIDTH] = width


@subroutine
def _only_root(b: Coefficients, degree: int) -> float:
    """The one root of p in (0, 1], p(0) < 0 ≤ p(1), by regula falsi with Illinois weights.

    No trial point is closer to an end than a rounding, so that the bracket of a root near an end shrinks from
    both sides.
    """
    low, high = 0.0, 1.0
    p_low, p_high = b[0], b[degree]
    side = 0
    while True:
        least = 1e-15 * high
        if high - low <= 2.0 * least:
            return high
        s: float = (low * p_high - high * p_low) / (p_high - p_low)
        s = min(max(s, low + least), high - least)
        p = evaluate(b, degree, s)
        if p == 0.0:
            return s
        if p > 0.0:
            high, p_high = s, p
            if side == 1:
                p_low *= 0.5
            side = 1
        else:
            low, p_low = s, p
            if side == -1:
                p_high *= 0.5
            side = -1
