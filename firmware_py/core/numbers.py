"""Scalar arithmetic with a defined result for every float: NaN never passes a limit.

Python's own min, max and comparisons let NaN through. Each function here gives the same bits interpreted and
compiled.
"""

import math

TAU = 2.0 * math.pi

LARGEST_TO_WRAP = 1e9
"""Limit of the wrapped angles, in rad or turns: a double resolves 1e-7 there. No real crank reaches it."""
TO_INTEGER = 6755399441055744.0
"""1.5 · 2⁵²: adding and then subtracting this constant rounds a number to the nearest integer."""


def clamp(value: float, limit: float) -> float:
    """`value` within ±`limit`; 0 if it is NaN, or if `limit` is NaN, negative or infinite."""
    if not 0.0 <= limit < math.inf:
        return 0.0
    if -limit <= value <= limit:
        return value
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return 0.0


def at_least(value: float, floor: float) -> float:
    """`value`, but no less than `floor`; `floor` for NaN."""
    return value if value >= floor else floor


def in_ticks(duration_s: float, tick_s: float, least: int = 0) -> int:
    """The whole number of ticks nearest to a duration, at least `least`."""
    return max(round(duration_s / tick_s), least)


def round_down(value: float) -> float:
    """The largest whole number not above `value`, which is within ±`LARGEST_TO_WRAP`.

    `math.floor` gives an integer, which a microcontroller converts by many instructions, and raises for NaN.
    """
    nearest = (value + TO_INTEGER) - TO_INTEGER
    return nearest - 1.0 if nearest > value else nearest


def fraction(turns: float) -> float:
    """The fractional part of `turns`, in [0, 1); 0 for NaN and beyond ±`LARGEST_TO_WRAP`."""
    if not -LARGEST_TO_WRAP <= turns <= LARGEST_TO_WRAP:
        return 0.0
    rest = turns - round_down(turns)
    return rest if 0.0 <= rest < 1.0 else 0.0


def wrap_pi(angle_rad: float) -> float:
    """`angle_rad` in (−π, π]; 0 for NaN and beyond ±`LARGEST_TO_WRAP`."""
    if not -LARGEST_TO_WRAP <= angle_rad <= LARGEST_TO_WRAP:
        return 0.0
    angle = angle_rad - TAU * round_down((angle_rad + math.pi) / TAU)
    return angle if -math.pi < angle <= math.pi else math.pi  # outside by rounding only


def wrap_two_pi(angle_rad: float) -> float:
    """`angle_rad` in [0, 2π); 0 for NaN and beyond ±`LARGEST_TO_WRAP`."""
    if not -LARGEST_TO_WRAP <= angle_rad <= LARGEST_TO_WRAP:
        return 0.0
    angle = angle_rad - TAU * round_down(angle_rad / TAU)
    return angle if 0.0 <= angle < TAU else 0.0  # outside by rounding only
