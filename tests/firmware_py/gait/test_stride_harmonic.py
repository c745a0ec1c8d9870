"""An impulse asked for while a gait is followed: which turns a stride it takes, and what it says."""

import math
from collections.abc import Callable

import pytest

from firmware_py.core.estimation.regime import INITIAL as NO_REGIME
from firmware_py.core.estimation.regime import Period, RegimeState
from firmware_py.core.gait import gait_lock, stride_harmonic
from firmware_py.core.gait.stride_harmonic import StrideHarmonicState
from firmware_py.interface.enums import Refusal
from firmware_py.shell.parameters import config_from

CONFIG = config_from(
    {"gait.follow": 1, "gait.lowest_ratio": 0.98, "gait.centre_ratio": 1.14, "hold.impulse_slope_n_s": 2.0}
)
TURN_ENDED = NO_REGIME._replace(ended=True, last=Period(1, 0.6, 0.5, 30.0))
STRIDE_S = 20.0 * math.pi / CONFIG.nominal.natural_rad_s
"""A tenth of r for each turn a stride: ten of them are r = 1."""

Impact = Callable[[float], float]


def linear(slope_n_s: float) -> Impact:
    """Impacts of 0.8 N s at r = 1.1, which grow with r."""
    return lambda ratio: 0.8 + slope_n_s * (ratio - 1.1)


def turn(
    state: StrideHarmonicState,
    harmonic: int,
    target_n_s: float,
    impact_n_s: float,
    regime: RegimeState = TURN_ENDED,
    holding: bool = True,
) -> StrideHarmonicState:
    """One tick, in which a turn of the crank may end, at the ratio of `harmonic` turns a stride."""
    lock = gait_lock.INITIAL._replace(harmonic=harmonic, base_ratio=0.1 * harmonic)
    now = gait_lock.Moment(
        moving=True,
        holding=holding,
        angle_rad=0.0,
        regime=regime,
        touch_down=False,
        since_touch_down_s=0.0,
        impact_n_s=impact_n_s,
    )
    return stride_harmonic.step(CONFIG.gait, state, lock, now, target_n_s)


def followed(impact: Impact, target_n_s: float, turns: int) -> tuple[StrideHarmonicState, list[int]]:
    """What comes of `turns` of the crank, each with one impact; and all turns a stride that were taken."""
    state, taken = stride_harmonic.INITIAL, [11]
    for _ in range(turns):
        harmonic = gait_lock.choose_turns(CONFIG.gait, STRIDE_S, taken[-1], state.aim_ratio)
        if harmonic != taken[-1]:
            taken.append(harmonic)
        state = turn(state, harmonic, target_n_s, impact(0.1 * harmonic))
    return state, taken


def test_a_stride_is_a_tenth_of_the_ratio_for_each_turn() -> None:
    for aim_ratio, harmonic in ((1.04, 10), (1.06, 11), (1.16, 12), (1.3, 13)):
        assert gait_lock.choose_turns(CONFIG.gait, STRIDE_S, 0, aim_ratio) == harmonic


def test_without_a_request_the_centre_counts() -> None:
    state, taken = followed(linear(2.0), 0.0, 200)
    assert (state.aim_ratio, state.refusal, taken) == (0.0, Refusal.NONE, [11])


@pytest.mark.parametrize("slope_n_s", [1.2, 2.0, 3.5])
@pytest.mark.parametrize("harmonic", [10, 11, 12, 13])
def test_the_turns_whose_impacts_come_nearest_are_found_and_kept(slope_n_s: float, harmonic: int) -> None:
    """Though the parameter J' is up to two times wrong; no turns are taken twice."""
    impact = linear(slope_n_s)
    state, taken = followed(impact, impact(0.1 * harmonic) * 1.01, 400)
    assert taken[-1] == harmonic
    assert len(set(taken)) == len(taken)
    assert state.refusal == Refusal.NONE
    assert state.impulse_n_s == pytest.approx(impact(0.1 * harmonic))


def test_a_request_midway_is_not_hunted_for() -> None:
    impact = linear(3.0)
    for share in (0.3, 0.45, 0.5, 0.55, 0.7):
        target_n_s = impact(1.1) + share * (impact(1.2) - impact(1.1))
        _, taken = followed(impact, target_n_s, 1000)
        assert len(taken) <= 3


@pytest.mark.parametrize(
    ("target_n_s", "refusal", "harmonic"),
    [(1.5, Refusal.IMPULSE_TOO_HIGH, 13), (0.2, Refusal.IMPULSE_TOO_LOW, 10)],
)
def test_a_request_that_no_turns_meet_is_reported_and_the_nearest_are_kept(
    target_n_s: float, refusal: Refusal, harmonic: int
) -> None:
    state, taken = followed(linear(2.0), target_n_s, 600)
    assert (state.refusal, taken[-1]) == (refusal, harmonic)


def test_nothing_is_reported_before_other_turns_had_their_time() -> None:
    """Five strides of eleven turns until it changes over, then six of thirteen."""
    refusals = [followed(linear(2.0), 1.5, turns)[0].refusal for turns in (55, 66, 132, 133)]
    assert refusals == [Refusal.NONE, Refusal.NONE, Refusal.NONE, Refusal.IMPULSE_TOO_HIGH]


def test_the_first_stride_does_not_count_and_turns_without_one_impact_never() -> None:
    state = stride_harmonic.INITIAL
    doubled = TURN_ENDED._replace(last=Period(2, 0.6, 0.5, 30.0))

    for _ in range(11):
        state = turn(state, 11, 0.8, 5.0)
    for impact_n_s in (0.7, 0.8, 0.9):
        state = turn(state, 11, 0.8, impact_n_s)
        state = turn(state, 11, 0.8, 9.0, doubled)
        state = turn(state, 11, 0.8, 9.0, NO_REGIME)
    assert state.impulse_n_s == pytest.approx(0.8)
    assert state.turns == 14


def test_who_stops_holding_begins_anew() -> None:
    state, _ = followed(linear(2.0), 1.0, 200)
    assert state.turns > 0
    for holding, harmonic in ((False, 11), (True, 0)):
        assert turn(state, harmonic, 1.0, 0.8, holding=holding) == stride_harmonic.INITIAL
