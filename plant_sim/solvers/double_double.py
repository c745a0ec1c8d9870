"""Sums and angles in two floats, so that a long run loses no precision.

A pair (high, low) stands for the unevaluated sum high + low with |low| ≤ ulp(high)/2: about 32 digits. Sums
after Knuth (The Art of Computer Programming 2, 4.2.2), products after Dekker (Numerische Mathematik 18,
1971).
"""

import math

from plant_sim.kernels import jit

TURN_RAD = 2.0 * math.pi
TURN_LOW_RAD = 2.4492935982947064e-16  # 2π − TURN_RAD
_TURNS_PER_RAD = 1.0 / TURN_RAD
_SPLIT = 134217729.0  # 2²⁷ + 1 halves a significand


@jit
def two_sum(a: float, b: float) -> tuple[float, float]:
    """a + b and its rounding error, exactly."""
    high = a + b
    part = high - a
    return high, (a - (high - part)) + (b - part)


@jit
def two_product(a: float, b: float) -> tuple[float, float]:
    """a b and its rounding error, exactly (no overflow up to 1e300)."""
    high = a * b
    scaled = _SPLIT * a
    a_high = scaled - (scaled - a)
    a_low = a - a_high
    scaled = _SPLIT * b
    b_high = scaled - (scaled - b)
    b_low = b - b_high
    return high, ((a_high * b_high - high) + a_high * b_low + a_low * b_high) + a_low * b_low


@jit
def add(high: float, low: float, term: float) -> tuple[float, float]:
    """The pair plus one float."""
    total, rest = two_sum(high, term)
    return two_sum(total, rest + low)


@jit
def quotient(a: float, b: float) -> tuple[float, float]:
    """a / b as a pair."""
    high = a / b
    product, rest = two_product(high, b)
    return high, ((a - product) - rest) / b


@jit
def square_root(high: float, low: float) -> tuple[float, float]:
    """√(high + low) as a pair, for high > 0."""
    root = math.sqrt(high)
    product, rest = two_product(root, root)
    return root, (((high - product) - rest) + low) / (2.0 * root)


@jit
def turn_by(
    angle_rad: float, angle_low_rad: float, rate_rad_s: float, rate_low_rad_s: float, duration_s: float
) -> tuple[float, float]:
    """The angle after turning at a constant rate for a duration, modulo 2π in [−π, π]."""
    product, product_low = two_product(rate_rad_s, duration_s)
    high, low = two_sum(angle_rad, product)
    low += angle_low_rad + (product_low + rate_low_rad_s * duration_s)
    turns = math.floor(high * _TURNS_PER_RAD + 0.5)
    if turns != 0.0:
        whole, whole_low = two_product(float(turns), TURN_RAD)
        high, rest = two_sum(high, -whole)
        low += (rest - whole_low) - turns * TURN_LOW_RAD
    return two_sum(high, low)
