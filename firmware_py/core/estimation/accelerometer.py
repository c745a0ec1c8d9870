"""The accelerometers' readings: choice between the striker's two ranges, and their offsets."""

import math
from typing import NamedTuple

from firmware_py.core.inputs import AccelerometerInput
from firmware_py.core.numbers import at_least, clamp
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.generated.parameters import Parameters

CLIPPED_SHARE = 0.98
"""Share of the full scale above which a reading may be clipped."""
FEWEST_HOUSING = 10
"""Weight of the housing's initial offset 0, in readings: at rest the true one is known at once."""
LARGEST_HOUSING_M_S2 = 0.5
"""Largest offset of the housing's accelerometer, 50 mg; a larger mean is of a tilt or a motion, which are no
offset: the striker's reading has them too."""
JOLTED_M_S2 = 2.0
"""Reading from which on the housing is jolted; it counts by the average's rate alone."""


class Constants(NamedTuple):
    """`…_rate`: share of a difference that a reading adds to an average."""

    housing_weight: float
    low_full_scale_m_s2: float
    high_full_scale_m_s2: float
    high_offset_rate: float
    housing_rate: float


def derive(p: Parameters) -> Constants:
    """The constants of these parameters."""
    tick_s = p.control.tick_s
    return Constants(
        housing_weight=p.sensor.housing_weight,
        low_full_scale_m_s2=p.sensor.low_full_scale_m_s2,
        high_full_scale_m_s2=p.sensor.high_full_scale_m_s2,
        high_offset_rate=min(tick_s / p.sensor.high_offset_s, 1.0),
        housing_rate=min(tick_s / p.sensor.housing_offset_s, 1.0),
    )


class SensorState(NamedTuple):
    """The reading in use: the low range, or the high range minus its offset where the low range clips.

    `before_m_s2` and `second_m_s2` are the two previous readings. `housing_m_s2` is without its offset.
    """

    acceleration_m_s2: float
    before_m_s2: float
    second_m_s2: float
    housing_m_s2: float
    housing_offset_m_s2: float
    housing_readings: int
    high_offset_m_s2: float
    clipped: bool
    missed_ticks: int


def sense(own: Constants, state: SensorState, new: AccelerometerInput) -> SensorState:
    """Choose the range, and learn the high range's offset from the low range at small readings.

    If the housing's reading is clipped or not finite, the striker's reading is not used either.
    """
    housing_used = own.housing_weight > 0.0
    if not (
        new.age_ticks == 0
        and math.isfinite(new.low_m_s2)
        and math.isfinite(new.high_m_s2)
        and math.isfinite(new.housing_m_s2)
        and not (housing_used and abs(new.housing_m_s2) > CLIPPED_SHARE * own.low_full_scale_m_s2)
    ):
        return state._replace(missed_ticks=min(state.missed_ticks + 1, NEVER_TICKS))
    offset_m_s2 = state.high_offset_m_s2
    if abs(new.low_m_s2) < 0.95 * own.low_full_scale_m_s2:
        acceleration_m_s2 = new.low_m_s2
        clipped = False
        # Only at small readings: the ranges differ on the flanks of an impact.
        if abs(new.low_m_s2) < 0.2 * own.low_full_scale_m_s2:
            offset_m_s2 += own.high_offset_rate * (new.high_m_s2 - new.low_m_s2 - offset_m_s2)
    else:
        acceleration_m_s2 = new.high_m_s2 - offset_m_s2
        clipped = abs(new.high_m_s2) > CLIPPED_SHARE * own.high_full_scale_m_s2
    rate, readings = own.housing_rate, state.housing_readings
    if abs(new.housing_m_s2) < JOLTED_M_S2:
        # At first the mean of all readings, later an exponential average.
        rate = at_least(1.0 / (state.housing_readings + FEWEST_HOUSING), rate)
        readings = min(state.housing_readings + 1, NEVER_TICKS)
    housing_offset_m_s2 = state.housing_offset_m_s2 + rate * (new.housing_m_s2 - state.housing_offset_m_s2)
    housing_offset_m_s2 = clamp(housing_offset_m_s2, LARGEST_HOUSING_M_S2)
    return SensorState(
        acceleration_m_s2=acceleration_m_s2,
        before_m_s2=state.acceleration_m_s2,
        second_m_s2=state.before_m_s2,
        housing_m_s2=new.housing_m_s2 - housing_offset_m_s2,
        housing_offset_m_s2=housing_offset_m_s2,
        housing_readings=readings,
        high_offset_m_s2=offset_m_s2,
        clipped=clipped,
        missed_ticks=0,
    )
