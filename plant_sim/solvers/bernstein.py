"""Polynomials on [0, 1] in Bernstein form, with root finding that cannot miss a root.

p(s) = Σ b_i C(n, i) sⁱ (1 − s)ⁿ⁻ⁱ lies in the hull of its coefficients and has at most as many roots in
(0, 1) as they have sign changes, with the same parity (Farin, Curves and Surfaces for CAGD, 5th ed. 2002,
chapter 5): no change proves that there is no root, one change brackets exactly one; with more changes the
interval is halved.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import jit, subroutine

DEGREE = 7
"""Degree of the continuous extension of a step of DOP853."""

ORDER = 16
"""Degree of a step that is a Taylor series: at an accuracy of 1e-10, 14, 18 and 20 are no faster."""

NO_ROOT = 2.0
"""Returned if there is no root in [0, 1]."""

ROOT_ROUNDING = 2e-15
"""Width, as a share of a root, of the bracket at which its location ends."""

DEEPEST_HALVING = 40
"""An excursion narrower than 2⁻⁴⁰ of a step is below rounding: it is no crossing."""


MOST_CHORDS = 60
"""Most trials of regula falsi; a root of a step takes about ten."""

NODES: FloatArray = np.array([0.5 - 0.5 * math.cos(math.pi * i / DEGREE) for i in range(DEGREE + 1)])
"""Interpolation nodes: Chebyshev points of the second kind, with both ends."""


def _basis(s: Fraction) -> list[Fraction]:
    """The Bernstein polynomials at s."""
    return [math.comb(DEGREE, i) * s**i * (1 - s) ** (DEGREE - i) for i in range(DEGREE + 1)]


def _inverse(matrix: list[list[Fraction]]) -> FloatArray:
    """The inverse, each number rounded once: the last bits of LAPACK's depend on processor and memory."""
    size = len(matrix)
    rows = [[*row, *(Fraction(i == j) for j in range(size))] for i, row in enumerate(matrix)]
    for i in range(size):
        pivot = next(k for k in range(i, size) if rows[k][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [one / rows[i][i] for one in rows[i]]
        for k in range(size):
            if k != i:
                rows[k] = [one - rows[k][i] * other for one, other in zip(rows[k], rows[i], strict=True)]
    return np.array([[float(one) for one in row[size:]] for row in rows])


_BINOMIALS: FloatArray = np.array(
    [[float(math.comb(n, i)) for i in range(ORDER + 1)] for n in range(ORDER + 1)]
)

_PER_BINOMIAL: FloatArray = 1.0 / np.maximum(_BINOMIALS, 1.0)

_START, _WIDTH = ORDER + 1, ORDER + 2
"""Columns of the stack of `first_rise` behind the coefficients."""

_FROM_VALUES: FloatArray = _inverse([_basis(Fraction(float(s))) for s in NODES])


class Scratch(NamedTuple):
    """Scratch arrays: shapes (ORDER + 1,) twice, (DEEPEST_HALVING + 2, ORDER + 3).

    Event location needs them, and between events the series of a walking leg needs the last.
    """

    poly: FloatArray
    press: FloatArray
    stack: FloatArray


def scratch_arrays() -> Scratch:
    """Scratch arrays."""
    return Scratch(np.zeros(ORDER + 1), np.zeros(ORDER + 1), np.zeros((DEEPEST_HALVING + 2, ORDER + 3)))


new_scratch = jit(scratch_arrays)
"""`scratch_arrays` for kernels."""


@subroutine
def interpolate(values: FloatArray, b: FloatArray) -> None:
    """Coefficients of the polynomial through `values` at NODES, into `b`."""
    for i in range(DEGREE + 1):
        b[i] = 0.0
        for j in range(DEGREE + 1):
            b[i] += _FROM_VALUES[i, j] * values[j]


@subroutine
def evaluate(b: FloatArray, degree: int, s: float) -> float:
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
def at(b: FloatArray, s: float) -> float:
    """p(s) of all coefficients."""
    return evaluate(b, b.size - 1, s)


@subroutine
def from_powers(powers: FloatArray, h: float, b: FloatArray, degree: int) -> None:
    """Coefficients of Σ c_k (h s)ᵏ, of degree n = `degree`, into `b`: b_i = Σ C(i, k) / C(n, k) c_k hᵏ."""
    scale = 1.0
    for k in range(degree + 1):
        b[k] = powers[k] * scale * _PER_BINOMIAL[degree, k]
        scale *= h
    for j in range(degree):
        for back in range(degree - j):
            i = np.uint64(degree - back)
            b[i] += b[np.uint64(degree - back - 1)]


@subroutine
def without_root_at_start(b: FloatArray, degree: int) -> None:
    """Replace p by p(s)/s, of one degree less, in place; p(0) is taken as 0."""
    for i in range(degree):
        b[i] = b[i + 1] * degree / (i + 1)


@subroutine
def first_rise(b: FloatArray, degree: int, stack: FloatArray, accuracy: float = ROOT_ROUNDING) -> float:
    """Smallest s in [0, 1] at which p, negative before, reaches 0; NO_ROOT if it never does, or p = 0.

    It is too late by `accuracy` at most, as a share of itself.

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
            return float(start + width * _only_root(c, degree, accuracy))
        if top == DEEPEST_HALVING:
            if c[degree] >= 0.0:
                return float(start)
            top -= 1
            continue
        _halve(stack, top, degree)
        top += 1
    return NO_ROOT


@subroutine
def _reaches_zero(b: FloatArray, degree: int) -> bool:
    highest: float = b[0]
    for i in range(1, degree + 1):
        highest = max(highest, b[i])
    return highest >= 0.0


@subroutine
def _is_zero(b: FloatArray, degree: int) -> bool:
    """Whether p = 0 throughout: a quantity that stays on a surface does not cross it."""
    largest = 0.0
    for i in range(degree + 1):
        largest = max(largest, abs(b[i]))
    return largest == 0.0


@subroutine
def _sign_changes(b: FloatArray, degree: int) -> int:
    changes = 0
    for i in range(degree):
        if (b[i] >= 0.0) != (b[i + 1] >= 0.0):
            changes += 1
    return changes


@subroutine
def _halve(stack: FloatArray, top: int, degree: int) -> None:
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
def _only_root(b: FloatArray, degree: int, accuracy: float) -> float:
    """The one root of p in (0, 1], p(0) < 0 ≤ p(1), by regula falsi with Illinois weights.

    No trial point is closer to an end than the accuracy, so that the bracket of a root near an end shrinks
    from both sides. After MOST_CHORDS trials, as with values near the least number, the bracket is halved.
    """
    low, high = 0.0, 1.0
    p_low, p_high = b[0], b[degree]
    side, trials = 0, 0
    while True:
        least = 0.5 * accuracy * high
        if high - low <= 2.0 * least:
            return high
        trials += 1
        s: float = (low * p_high - high * p_low) / (p_high - p_low)
        if trials > MOST_CHORDS:
            s = 0.5 * (low + high)
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


@subroutine
def root(
    b: FloatArray,
    sign: float,
    offset: float,
    zeros: int,
    scratch: Scratch,
    accuracy: float = ROOT_ROUNDING,
) -> float:
    """First s at which sign · p(s) + offset, negative at first, reaches 0.

    `zeros` leading derivatives, the value included, are zero at s = 0, which is no such root. `accuracy` is
    that of `first_rise`.
    """
    poly = scratch.poly
    degree = b.size - 1
    for i in range(b.size):
        poly[i] = sign * b[i] + offset
    while degree > b.size - 1 - zeros:
        without_root_at_start(poly, degree)
        degree -= 1
    return first_rise(poly, degree, scratch.stack, accuracy)


@subroutine
def first_beyond(b: FloatArray, slope: float, offset: float, limit: float, scratch: Scratch) -> float:
    """First s at which |slope · p(s) + offset|, below the limit at first, passes it."""
    upward = root(b, slope, offset - limit, 0, scratch)
    return min(upward, root(b, -slope, -offset - limit, 0, scratch))
