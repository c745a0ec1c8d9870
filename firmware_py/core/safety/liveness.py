"""Signs of life of each accelerometer channel, at every speed, at rest too.

    take(limits, state, sample) -> state      once for each frame that counts
    is_alive(limits, state) -> bool

The noise of a working accelerometer exceeds its counts (2 counts rms in the high range, 3 in the others), so
it does not repeat a reading `READINGS` times; and the striker's two ranges read the same acceleration, as far
as the low range reaches. What neither shows: both ranges the wrong way round, and one range whose error is
smaller than the offset allowed to the high range.
"""

from typing import NamedTuple

from firmware_py.core.numbers import clamp
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.interface.zeroed import zeroed

READINGS = 30
"""Readings in a row without a sign of life that are a dead channel. Of 2 counts of noise 1 reading in 7
repeats the one before; 30 in a row never do. An impact's flanks, where the ranges differ, are shorter."""


class LifeState(NamedTuple):
    """The newest reading of each channel, and the readings in a row that repeat it, or differ."""

    low_m_s2: float
    high_m_s2: float
    housing_m_s2: float
    same_low: int
    same_high: int
    same_housing: int
    differing: int


INITIAL = zeroed(LifeState)


def count(readings: int, condition: bool) -> int:
    """The number of readings in a row with a condition, after this one."""
    return min(readings + 1, READINGS + 1) if condition else 0


def take(limits: GateLimits, state: LifeState, sample: Accelerometer) -> LifeState:
    """The state after one frame. A low range at full scale repeats itself in a long impact and may do so."""
    low_m_s2, high_m_s2, housing_m_s2 = sample
    clipped = not abs(low_m_s2) < limits.low_clipped_m_s2
    shown_m_s2 = clamp(high_m_s2, limits.low_clipped_m_s2)
    differ = not abs(shown_m_s2 - clamp(low_m_s2, limits.low_clipped_m_s2)) <= limits.differ_m_s2
    return LifeState(
        low_m_s2=low_m_s2,
        high_m_s2=high_m_s2,
        housing_m_s2=housing_m_s2,
        same_low=count(state.same_low, low_m_s2 == state.low_m_s2 and not clipped),
        same_high=count(state.same_high, high_m_s2 == state.high_m_s2),
        same_housing=count(state.same_housing, housing_m_s2 == state.housing_m_s2),
        differing=count(state.differing, differ),
    )


def is_alive(limits: GateLimits, state: LifeState) -> bool:
    """Whether every channel that a limit reads shows signs of life; the housing's counts where it is used."""
    return (
        state.same_low <= READINGS
        and state.same_high <= READINGS
        and (state.same_housing <= READINGS or not limits.reads_housing)
        and state.differing <= READINGS
    )
