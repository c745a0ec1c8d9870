"""Scalar arithmetic that fails safe: what is no number never passes a limit."""

import math

from firmware_py.core.compiled import compiled

TAU = 2.0 * math.pi


@compiled
def limited(value: float, limit: float) -> float:
    """`value` within ±`limit` (≥ 0); 0 for NaN, which a min(max()) would let through."""
    if -limit <= value <= limit:
        return value
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return 0.0


@compiled
def at_least(value: float, floor: float) -> float:
    """`value`, but no less than `floor`; `floor` for NaN."""
    return value if value >= floor else floor


@compiled
def wrapped(angle_rad: float) -> float:
    """`angle_rad` in [−π, π)."""
    return angle_rad - TAU * math.floor((angle_rad + math.pi) / TAU)


@compiled
def turned(angle_rad: float) -> float:
    """`angle_rad` in [0, 2π)."""
    angle = angle_rad - TAU * math.floor(angle_rad / TAU)
    return angle if angle < TAU else 0.0
