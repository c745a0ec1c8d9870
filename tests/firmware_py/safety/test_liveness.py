"""Each accelerometer channel has signs of life of its own, at every speed."""

import math
import random

import pytest

from firmware_py.core.safety import liveness
from firmware_py.core.safety.liveness import READINGS, LifeState
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.shell.parameters import config_from

LIMITS = config_from({}).gate
Readings = tuple[float, float, float]


def after(readings: int, of_life: Readings, step: Readings, limits: object = LIMITS) -> LifeState:
    """The state after some readings that move on by a step each, and one before them."""
    state = liveness.INITIAL
    for place in range(readings + 1):
        shown = [start + by * (place % 2) for start, by in zip(of_life, step, strict=True)]
        state = liveness.take(limits, state, Accelerometer(*shown))
    return state


NOISE = (0.01, 0.5, 0.01)


@pytest.mark.parametrize("channel", range(3))
@pytest.mark.parametrize("level", [0.0, 3.0, -7.0])
def test_a_channel_that_repeats_itself_is_dead(channel: int, level: float) -> None:
    step: Readings = tuple(0.0 if place == channel else by for place, by in enumerate(NOISE))  # type: ignore[assignment]
    start = (level, level, level)
    first = 1 if level == 0.0 else 0  # before the first reading the channels are known as 0
    assert liveness.is_alive(LIMITS, after(READINGS - first, start, step))
    dead = after(READINGS + 1 - first, start, step)
    assert not liveness.is_alive(LIMITS, dead)
    assert liveness.is_alive(
        LIMITS, liveness.take(LIMITS, dead, Accelerometer(level + 0.02, level + 0.02, level + 0.02))
    )
    unread = LIMITS._replace(reads_housing=False)
    assert liveness.is_alive(unread, dead) == (channel == 2)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("low", "high", "alive"),
    [
        (0.0, 12.4, True),
        (0.0, 13.6, False),
        (13.6, 0.0, False),
        (8.0, -8.0, False),  # one of them the wrong way round
        (145.0, 1000.0, True),  # the low range is near its end: the high one is clamped to it
        (156.9, 1000.0, True),  # a long impact beyond the low range, which may repeat itself
        (156.9, 100.0, False),
        (0.0, math.nan, True),  # the force limit's finding
        (math.nan, 50.0, False),
    ],
)
def test_the_two_ranges_agree_as_far_as_the_low_one_reaches(
    low: float, high: float, alive: bool, side: float
) -> None:
    """10 m/s² of offset and 3 m/s² beyond; at the end of the low range within them, too."""
    shown = (side * low, side * high, 0.0)
    assert LIMITS.differ_m_s2 == 13.0
    assert liveness.is_alive(LIMITS, after(READINGS - 1, shown, NOISE))
    assert liveness.is_alive(LIMITS, after(200, shown, (0.01 if low < 150.0 else 0.0, 0.3, 0.01))) == alive
    assert liveness.is_alive(
        LIMITS, liveness.take(LIMITS, after(200, shown, NOISE), Accelerometer(0.01, 0.5, 0.01))
    )


def test_the_largest_difference_is_that_of_the_sensors_data_sheet() -> None:
    assert config_from({"sensor.high_offset_m_s2": 4.0}).gate.differ_m_s2 == 7.0
    assert config_from({"sensor.housing_weight": 0.0}).gate.reads_housing is False
    assert config_from({"sensor.low_full_scale_m_s2": 100.0}).gate.low_clipped_m_s2 == pytest.approx(98.0)


def test_a_difference_at_its_limit_is_allowed_and_a_low_range_at_its_end_may_repeat_itself() -> None:
    assert READINGS == 30
    assert liveness.take(LIMITS, liveness.INITIAL, Accelerometer(0.0, LIMITS.differ_m_s2, 0.0)).differing == 0
    end_m_s2 = LIMITS.low_clipped_m_s2
    assert after(5, (end_m_s2, end_m_s2, 0.0), (0.0, 0.0, 0.0)).same_low == 0


@pytest.mark.parametrize(("noise_counts", "seconds", "alive"), [(2.0, 100, True), (0.33, 10, False)])
def test_noise_of_2_counts_is_a_sign_of_life(noise_counts: float, seconds: int, alive: bool) -> None:
    """At rest, in the middle of a count: a sensor with less than a third of a count of noise is refused."""
    dice, state = random.Random(1), liveness.INITIAL
    found = True
    for _ in range(1000 * seconds):
        shown = (0.01 * round(dice.gauss(0.0, noise_counts)) for _ in range(3))
        state = liveness.take(LIMITS, state, Accelerometer(*shown))
        found = found and liveness.is_alive(LIMITS, state)
    assert found is alive
