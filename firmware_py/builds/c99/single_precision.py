"""Constants in single precision: each is rounded once, but for a few that depend on the number format.

These are constants of `core.elementary` and `core.numbers`; they have other values in single precision.
"""

import math
import struct
from collections.abc import Iterator
from fractions import Fraction

from firmware_py.core import elementary, numbers

SINGLE_BITS = 24
"""Bits of a float's significand."""

_SPLIT: tuple[tuple[tuple[float, ...], int], ...] = (
    # 17 bits, so that the product with up to 64 quarter turns is exact
    ((elementary._QUARTER_1, elementary._QUARTER_2, elementary._QUARTER_REST), 17),
    # 12 bits, so that the product with up to 2¹¹ doublings is exact
    ((elementary._LN2, elementary._LN2_REST), 12),
    ((math.pi, elementary._PI_REST), SINGLE_BITS),
    ((0.5 * math.pi, elementary._HALF_PI_REST), SINGLE_BITS),
    ((0.25 * math.pi, elementary._QUARTER_PI_REST), SINGLE_BITS),
    ((elementary._ATAN_1_2, elementary._ATAN_1_2_REST), SINGLE_BITS),
    ((elementary._ATAN_3_2, elementary._ATAN_3_2_REST), SINGLE_BITS),
)
"""Constants that are sums of several floats, and the bits of all terms but the last one."""


def round_to_single(value: Fraction | float) -> float:
    """The nearest number of single precision; infinite from halfway between the largest one and 2¹²⁸ on.

    >>> round_to_single(0.1)
    0.10000000149011612
    """
    try:
        rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return rounded


def split_number(number: Fraction, count: int, bits: int) -> Iterator[float]:
    """A positive number as a sum of floats; all terms but the last have at most `bits` bits.

    >>> [float(piece).hex() for piece in split_number(Fraction(1, 3), 2, 4)]
    ['0x1.6000000000000p-2', '-0x1.5555560000000p-7']
    """
    for _ in range(count - 1):
        unit = Fraction(2) ** (math.frexp(number)[1] - bits)
        piece = round(number / unit) * unit
        yield float(piece)
        number -= piece
    yield round_to_single(number)


def _replaced() -> Iterator[tuple[float, float]]:
    yield numbers.TO_INTEGER, 1.5 * 2.0**23
    yield elementary._LARGEST_STEP, 2.0**32  # its cube is finite
    yield elementary._HALF, 2.0**12 + 1.0
    for terms, bits in _SPLIT:
        exact = sum(map(Fraction, terms), Fraction())
        yield from zip(terms, split_number(exact, len(terms), bits), strict=True)


REPLACED = {value: other for value, other in _replaced() if other != round_to_single(value)}
"""Constants that are not merely rounded, with their values for single precision."""


def in_single_precision(value: float) -> float:
    """A constant of the firmware in single precision."""
    return value if math.isnan(value) else REPLACED.get(value, round_to_single(value))
