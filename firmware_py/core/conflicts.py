"""Parameters that are within their own bounds but do not fit together.

A module without any fault would not reach its goal with them: its start or its recovery ends at
`LONGEST_SEARCH_S`, or its speed limit lies below the highest ratio. Or a monitor could not act: the crank may
be slower than `SLOWEST_RAD_S`.
"""

import math
from enum import IntEnum

from firmware_py.core.control.start import DIP_S, LONGEST_SEARCH_S
from firmware_py.core.numbers import TAU
from firmware_py.core.safety.monitors import SLOWEST_RAD_S
from firmware_py.interface.generated.parameters import Parameters

TOLERANCE = 1e-6
"""Relative rounding error of a sum of values that came over the bus."""


class Conflict(IntEnum):
    """What does not fit together."""

    NONE = 0
    LONG_START = 1
    LONG_RECOVERY = 2
    FAST_RATIO = 3
    RATIO_BELOW_FREE = 4
    SLOW_RATIO = 5


def start_s(p: Parameters, turn_s: float) -> float:
    """Longest start without a dip: both S-curves, then the confirming periods at the lowest ratio."""
    ratio = max(p.start.capture_ratio, p.start.lowest_ratio)
    approach_s = p.start.approach_s if p.start.approach_s < p.start.rise_s else 0.0
    return approach_s + p.start.rise_s + p.start.confirm_periods * turn_s / ratio


def recovery_s(p: Parameters, turn_s: float) -> float:
    """Longest recovery with one dip: the lost periods, the dip and its periods, the rise, confirmation."""
    ratio = max(p.start.capture_ratio, p.start.lowest_ratio)
    dwell_s = p.start.dwell_periods * turn_s / p.start.dip_ratio
    periods = p.start.lost_periods + p.start.confirm_periods
    return DIP_S + dwell_s + p.start.again_s + periods * turn_s / ratio


def nominal_rad_s(p: Parameters) -> float:
    """The striker's nominal natural frequency."""
    return math.sqrt(p.striker.spring_n_m / p.striker.mass_kg)


def highest_ratio(p: Parameters) -> float:
    """The highest ratio that the operator or the gait can ask for."""
    return p.gait.highest_ratio + p.gait.margin if p.gait.follow > 0 else p.start.highest_ratio


def lowest_ratio(p: Parameters) -> float:
    """The lowest ratio at which the crank is kept: the lowest that can be asked for, or that of the dip."""
    asked = p.gait.lowest_ratio - p.gait.margin if p.gait.follow > 0 else p.start.lowest_ratio
    return min(asked, p.start.dip_ratio)


def conflict_of(p: Parameters) -> Conflict:
    """The first conflict of these parameters, or NONE."""
    natural_rad_s = nominal_rad_s(p)
    turn_s, highest = TAU / natural_rad_s, highest_ratio(p)
    if start_s(p, turn_s) > LONGEST_SEARCH_S:
        return Conflict.LONG_START
    if recovery_s(p, turn_s) > LONGEST_SEARCH_S:
        return Conflict.LONG_RECOVERY
    if highest * natural_rad_s > p.limit.speed_rad_s * (1.0 + TOLERANCE):
        return Conflict.FAST_RATIO
    if p.gait.follow > 0 and highest > p.start.free_ratio * (1.0 + TOLERANCE):
        return Conflict.RATIO_BELOW_FREE
    if lowest_ratio(p) * natural_rad_s <= SLOWEST_RAD_S * (1.0 + TOLERANCE):
        return Conflict.SLOW_RATIO
    return Conflict.NONE
