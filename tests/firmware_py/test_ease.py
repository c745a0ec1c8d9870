import math

import pytest

from firmware_py.core import ease, regime
from firmware_py.core.ease import EaseConfig, EaseState
from firmware_py.core.regime import Period, RegimeState
from firmware_py.shell.parameters import config_from

CONFIG = EaseConfig(
    tick_s=1e-3,
    depth=0.2,
    late_rad=math.radians(40.0),
    early_rad=math.radians(300.0),
    weak_m_s=0.4,
    lag_s=0.05,
)
QUIET = regime.INITIAL


def blow(speed_m_s: float, impacts: int = 1) -> Period:
    return Period(impacts, speed_m_s, 0.2, 300.0)


def crank(past_deg: float) -> float:
    """The crank's angle so far past its forward dead centre."""
    return math.radians(past_deg + 90.0) % (2.0 * math.pi)


@pytest.mark.parametrize(
    ("past_deg", "share"),
    [(0.0, 0.0), (39.0, 0.0), (41.0, 0.2), (180.0, 0.2), (299.0, 0.2), (301.0, 0.0), (359.0, 0.0)],
)
def test_a_missed_blow_slows_the_crank_between_two_angles(past_deg: float, share: float) -> None:
    assert ease.wanted(CONFIG, crank(past_deg), QUIET) == share


@pytest.mark.parametrize(
    ("speed_m_s", "share"), [(0.0, 0.2), (0.1, 0.15), (0.3, 0.05), (0.4, 0.0), (0.9, 0.0), (math.nan, 0.0)]
)
def test_a_weak_blow_does_so_by_less_and_a_hard_one_not_at_all(speed_m_s: float, share: float) -> None:
    struck = regime.INITIAL._replace(running=blow(speed_m_s))
    assert ease.wanted(CONFIG, crank(90.0), struck) == pytest.approx(share)


def test_the_blow_counts_until_the_next_may_come_though_its_period_is_over() -> None:
    before = regime.INITIAL._replace(running=blow(0.9))
    after = regime.INITIAL._replace(last=blow(0.9))
    for past_deg, seen, other in ((269.0, before, after), (271.0, after, before)):
        assert ease.wanted(CONFIG, crank(past_deg), seen) == 0.0
        assert ease.wanted(CONFIG, crank(past_deg), other) == 0.2


def share_after(ticks: int, state: EaseState, rising: bool, elapsed_ticks: int = 1) -> EaseState:
    for _ in range(ticks):
        state = ease.step(CONFIG, state, rising, crank(90.0), QUIET, elapsed_ticks)
    return state


def test_what_is_given_up_comes_and_goes_without_a_jump() -> None:
    state = share_after(50, ease.INITIAL, rising=True)
    assert state.share == pytest.approx(0.2 * (1.0 - math.exp(-1.0)), rel=0.02)
    assert state.rate_1_s == pytest.approx((0.2 - state.share) / 0.05, rel=0.05)
    assert share_after(1000, state, rising=True).share == pytest.approx(0.2)
    gone = share_after(50, state, rising=False)
    assert gone.share == pytest.approx(state.share * math.exp(-1.0), rel=0.02)
    assert gone.rate_1_s < 0.0


def test_a_long_tick_goes_no_further_than_its_end() -> None:
    state = share_after(1, ease.INITIAL, rising=True, elapsed_ticks=200)
    assert state == EaseState(0.2, pytest.approx(1.0))


def test_the_slope_that_is_fed_forward_is_the_speeds_own() -> None:
    """By differences along a curve that rises by 2 rad/s² from 9 rad/s."""
    state, speeds, slopes = ease.INITIAL, [], []
    for tick in range(100):
        state = ease.step(CONFIG, state, True, crank(90.0), QUIET, 1)
        omega_rad_s, slope_rad_s2 = ease.eased(state, 9.0 + 2e-3 * tick, 2.0)
        speeds.append(omega_rad_s)
        slopes.append(slope_rad_s2)
    for k in range(1, 100):
        assert (speeds[k] - speeds[k - 1]) / 1e-3 == pytest.approx(slopes[k], abs=0.05)


def test_without_a_depth_nothing_is_given_up() -> None:
    config = config_from({"ease.depth": 0.0}).ease
    seen: RegimeState = QUIET
    for past_deg in range(360):
        assert ease.step(config, ease.INITIAL, True, crank(past_deg), seen, 1) == ease.INITIAL


def test_what_is_weak_goes_with_the_module() -> None:
    """By ω times the gap: a stiffer spring strikes harder, whichever side the stop is on."""
    soft = config_from({}).ease.weak_m_s
    stiff = config_from({"striker.spring_n_m": 4.0 * 70.0}).ease.weak_m_s
    assert stiff == pytest.approx(2.0 * soft)
    assert soft == pytest.approx(config_from({}).start.natural_rad_s * 0.06 * 0.62, rel=0.6)
