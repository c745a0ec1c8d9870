"""The hold: its window and end, the striker's true regime in it, and the impacts that must be detected."""

import numpy as np
import pytest
from run_folder import records

from firmware_py.interface.enums import Mode, Regime
from hil.figures import detection, true_regime
from hil.figures.hold import Window, capture, commanded_end_s, hold_motion, hold_window

RUN, READY = Mode.RUN, Mode.READY


@pytest.mark.parametrize(
    ("modes", "window"),
    [
        ([READY] * 5, None),
        ([READY, RUN, READY], (1.0, 1.0)),
        ([READY, RUN, RUN, RUN, READY], (1.0, 3.0)),
        ([RUN, RUN, READY, RUN, RUN, RUN], (3.0, 5.0)),
        ([RUN, RUN, RUN, READY, RUN, RUN], (0.0, 2.0)),
    ],
)
def test_the_hold_is_the_longest_uninterrupted_time_in_run(modes, window):
    assert hold_window(records(t_s=range(len(modes)), outputs__mode=modes)) == window
    assert Window(1.0, 2.0).holds(np.array([0.9, 1.0, 2.0, 2.1])).tolist() == [False, True, True, False]


COMMANDS = [{"at_s": 1.0, "request": "run"}, {"at_s": 9.0, "request": "idle"}]


@pytest.mark.parametrize(
    ("script", "start_s", "end_s"),
    [
        ({"commands": COMMANDS, "duration_s": 12.0}, 2.0, 9.0),
        ({"commands": COMMANDS, "duration_s": 12.0}, 0.5, 9.0),
        ({"commands": COMMANDS, "duration_s": 12.0}, 9.0, 12.0),
        ({"commands": COMMANDS[:1], "duration_s": 12.0}, 2.0, 12.0),
        ({}, 2.0, None),
    ],
)
def test_the_script_ends_a_hold_by_its_next_other_command_or_by_its_own_end(script, start_s, end_s):
    assert commanded_end_s({"script": script}, start_s) == end_s


@pytest.mark.parametrize(
    ("impacts_t_s", "capture_s"),
    [
        ([], None),
        ([2.0, 3.0, 4.5, 6.0, 7.5, 8.5], 2.0),  # gaps of 1.5 periods, also to the hold's end at 10 s
        ([2.0, 3.0, 4.5, 6.0, 7.5, 8.4], None),
        ([2.0, 3.0, 4.6, 6.3, 7.5, 9.0], 6.3),
        ([9.0], 9.0),
    ],
)
def test_the_capture_is_the_first_impact_after_which_no_period_lacks_one(impacts_t_s, capture_s):
    assert capture(np.array(impacts_t_s), Window(0.0, 10.0), 1.0) == capture_s


T_S = np.arange(0.0, 12.0, 1e-2)
PERIOD = 0.5
TOUCHES_S = np.arange(1.2, 11.0, PERIOD)
IMPACTS = records(
    t_s=TOUCHES_S,
    v_m_s=np.select([TOUCHES_S < 6.0, TOUCHES_S > 10.5], [1.0, 5.0], 0.9),
    impulse_n_s=np.select([TOUCHES_S < 6.0, TOUCHES_S > 10.5], [1.3, 9.0], 1.2),
)


TURNING_RAD = np.mod(2.0 * np.pi * T_S / PERIOD, 2.0 * np.pi)


def moved(hold=(2.0, 10.1), impacts=IMPACTS, crank_rad=TURNING_RAD):
    plant = records(t_s=T_S, crank_rad=crank_rad, v_m_s=np.cos(T_S))
    return hold_motion(plant, impacts, None if hold is None else Window(*hold))


def test_a_hold_with_an_impact_in_each_turn_has_its_speed_and_impulse_from_its_second_half():
    found = moved()
    assert (found.regime, found.impacts_per_period, found.capture_s) == (Regime.IMPACT, 1.0, 1.2)
    assert (found.impact_v_m_s, found.impact_impulse_n_s) == (0.9, 1.2)


def test_an_impact_that_fails_to_come_delays_the_capture_and_one_too_weak_to_feel_is_none():
    weak = IMPACTS.copy()
    weak["v_m_s"][8] = 0.04
    for impacts in (weak, np.delete(IMPACTS, 8)):
        found = moved(impacts=impacts)
        assert (found.regime, found.capture_s) == (Regime.IMPACT, pytest.approx(TOUCHES_S[9]))
        assert 0.9 < found.impacts_per_period < 1.0


def test_an_impact_at_the_very_end_of_the_hold_counts_and_one_long_before_it_does_not():
    last_s = float(TOUCHES_S[9])
    assert moved(hold=(2.0, last_s), impacts=IMPACTS[9:]).capture_s == last_s
    # The hold lasts less than a turn; its last impact was 2.4 turns before its end.
    assert moved(hold=(2.0, 2.4), impacts=IMPACTS[:1]).capture_s is None


def test_what_a_hold_does_not_have_is_unknown():
    nothing = (Regime.UNCERTAIN, None, None, None, None)
    assert moved(hold=None) == nothing
    assert hold_motion(records(t_s=[])[:0], IMPACTS, Window(2.0, 10.0)) == nothing
    assert moved(impacts=IMPACTS[:0]) == (Regime.NON_IMPACT, 0.0, None, None, None)
    # No turn of the crank, no tick of the plant: there are no drive periods to lack an impact.
    assert moved(crank_rad=np.zeros(len(T_S)))[:3] == (Regime.UNCERTAIN, None, 1.2)
    assert moved(hold=(13.0, 14.0))[:3] == (Regime.UNCERTAIN, None, 1.2)


# --- regime, by truth --------------------------------------------------------------------------------

OMEGA = 10.0
PERIOD_S = 2 * np.pi / OMEGA


def decide(impacts, *, periods=20, speed=1.0):
    """The regime of impacts given as (period number, phase in periods, v⁻)."""
    t_s = np.arange(0.0, periods * PERIOD_S, 1e-3)
    crank_rad = np.mod(OMEGA * t_s, 2 * np.pi)
    v_m_s = speed * np.cos(OMEGA * t_s)
    table = np.array(impacts, float).reshape(-1, 3)
    hits_s = (table[:, 0] + table[:, 1]) * PERIOD_S
    cut = true_regime.cut_periods(t_s, crank_rad, hits_s)
    return true_regime.decide(t_s, v_m_s, cut, hits_s, table[:, 2])


@pytest.mark.parametrize(
    ("impacts", "wanted"),
    [
        ([], Regime.NON_IMPACT),
        ([(k, 0.3, 0.9) for k in range(20)], Regime.IMPACT),
        # Jitter, around the crank's own zero too, must not move impacts into the neighbouring period.
        ([(k, 0.02 * (-1) ** k, 0.9) for k in range(1, 20)], Regime.IMPACT),
        ([(k, 0.25 + 0.02 * (-1) ** k, 0.9) for k in range(20)], Regime.IMPACT),
        ([(k, 0.3, 0.9) for k in range(0, 20, 2)], Regime.PERIOD_N),
        ([(k, 0.3, 0.9 if k % 2 else 0.5) for k in range(20)], Regime.PERIOD_N),
        ([(k, 0.3, 0.9 if k % 3 else 0.5) for k in range(20)], Regime.PERIOD_N),
        ([(k, 0.3, 0.9) for k in range(8)], Regime.LOST),
        ([(k, 0.1 * j, 0.5 / 2**j) for k in range(20) for j in range(6)], Regime.CHATTERING),
        ([(k, 0.3, 0.9) for k in (10, 11, 14, 15, 17, 18)], Regime.UNCERTAIN),
    ],
)
def test_regime_by_truth(impacts, wanted):
    assert decide(impacts) is wanted


def test_a_striker_at_rest_is_stuck():
    assert decide([], speed=1e-6) is Regime.STUCK


def test_too_few_periods_decide_nothing():
    assert decide([(0, 0.3, 0.9), (1, 0.3, 0.9)], periods=3) is Regime.UNCERTAIN


def decide_periods(counts, speeds=None, v_m_s=1.0):
    """The regime of periods of 1 s with these numbers of impacts and mean approach speeds."""
    counts = np.asarray(counts)
    speeds = np.ones(len(counts)) if speeds is None else np.asarray(speeds, float)
    edges_s, t_s = np.arange(len(counts) + 1.0), np.arange(0.0, len(counts), 0.5)
    hits_s = np.repeat(edges_s[:-1] + 0.5, counts)
    v_m_s = np.broadcast_to(v_m_s, len(t_s))
    return true_regime.decide(
        t_s, v_m_s, true_regime.Periods(edges_s, counts), hits_s, np.repeat(speeds, counts)
    )


WILD = np.linspace(1.0, 9.0, 40) ** 2
"""Approach speeds that never repeat."""


@pytest.mark.parametrize(
    ("counts", "speeds", "v_m_s", "wanted"),
    [
        # Four periods are enough; the middle one of an odd number belongs to the half that decides.
        ([1] * 4, None, 1.0, Regime.IMPACT),
        ([1, 1, 1, 0, 0], None, 1.0, Regime.UNCERTAIN),
        # One impact, long ago, is no lost regime; two periods with impacts are.
        ([1, 0, 0, 0, 0, 0], None, 1.0, Regime.NON_IMPACT),
        ([1, 1, 0, 0, 0, 0], None, 1.0, Regime.LOST),
        # Up to eight periods until an orbit repeats, once.
        (([1] * 7 + [0]) * 4, None, 1.0, Regime.PERIOD_N),
        (([1] * 8 + [0]) * 6, None, 1.0, Regime.UNCERTAIN),
        # One period in 20 may differ, in the number of impacts or in their speed.
        ([2] * 41 + [0], None, 1.0, Regime.IMPACT),
        ([2] * 39 + [0], None, 1.0, Regime.UNCERTAIN),
        ([1] * 39 + [2], WILD, 1.0, Regime.IMPACT),
        ([1] * 38 + [2, 2], WILD, 1.0, Regime.UNCERTAIN),
        # Speeds within a tenth of the larger one are equal.
        ([1] * 20, [10.0, 9.0] * 10, 1.0, Regime.IMPACT),
        ([1] * 20, [10.0, 8.9] * 10, 1.0, Regime.PERIOD_N),
        # Chattering begins at four impacts in a period.
        ([4] * 8, None, 1.0, Regime.CHATTERING),
        ([3] * 8, None, 1.0, Regime.IMPACT),
        # Stuck is a striker that stays below 1 mm/s throughout the half that decides.
        ([0] * 4, None, [9.0] * 4 + [0.0] * 4, Regime.STUCK),
        ([0] * 4, None, [0.0] * 4 + [9.0] + [0.0] * 3, Regime.NON_IMPACT),
        ([0] * 4, None, 0.9e-3, Regime.STUCK),
        ([0] * 4, None, 1e-3, Regime.NON_IMPACT),
    ],
)
def test_the_regime_by_the_impacts_of_each_period(counts, speeds, v_m_s, wanted):
    assert decide_periods(counts, speeds, v_m_s) is wanted


@pytest.mark.parametrize(("first", "hits", "periods"), [(-0.1, [], 4), (0.05, [], 3), (0.05, [0.6, 1.6], 4)])
def test_a_window_has_all_the_whole_turns_between_its_first_and_its_last_tick(first, hits, periods):
    """18 ticks, 4.25 turns. Without impacts a period begins at angle 0, else half a turn before they come."""
    turns = first + 0.25 * np.arange(18)
    found = true_regime.cut_periods(turns, 2.0 * np.pi * np.mod(turns, 1.0), np.array(hits))
    assert len(found.counts) == periods


def test_an_empty_window_has_no_periods():
    assert len(true_regime.cut_periods(np.zeros(0), np.zeros(0), np.zeros(0)).counts) == 0


# --- matching ----------------------------------------------------------------------------------------


def test_each_detection_has_the_latest_touch_down_in_its_window_that_is_free():
    random = np.random.default_rng(3)
    for _ in range(60):
        truth = np.sort(random.uniform(0.0, 0.15, random.integers(0, 6)))
        found = np.sort(random.uniform(0.0, 0.18, random.integers(0, 6)))
        pairs = detection.match(truth, found)
        of_detection = dict(zip(pairs.detection.tolist(), pairs.truth.tolist(), strict=True))
        taken: set[int] = set()
        for number, at_s in enumerate(found):
            latency_s = at_s - truth
            within = (latency_s >= -detection.LARGEST_LEAD_S) & (latency_s <= detection.LONGEST_LATENCY_S)
            free = [one for one in np.flatnonzero(within).tolist() if one not in taken]
            assert of_detection.get(number) == (free[-1] if free else None)
            taken |= {*free[-1:]}
        assert np.flatnonzero(pairs.found).tolist() == sorted(taken) == pairs.truth.tolist()
        assert np.flatnonzero(~pairs.false).tolist() == sorted(of_detection)
        assert pairs.latency_s.tolist() == (found[pairs.detection] - truth[pairs.truth]).tolist()


@pytest.mark.parametrize(
    ("truth", "found", "matched"),
    [
        ([1.0, 1.002], [1.006], [1]),
        ([1.0, 1.002], [1.006, 1.007], [0, 1]),
        ([1.0], [0.999, 1.006], [0]),
        ([1.0], [0.998, 1.041], []),
        ([], [1.0], []),
    ],
)
def test_a_detection_belongs_to_one_touch_down_only(truth, found, matched):
    assert detection.match(np.array(truth), np.array(found)).truth.tolist() == matched


def test_a_touch_that_no_wearer_feels_need_not_be_seen():
    v_m_s = np.array([0.04, 0.05, 0.09, 0.09, 0.06])
    peak_force_n = np.array([6.0, 6.0, 1.3, 5.0, np.nan])  # nan: a rigid stop
    assert detection.is_due(v_m_s, peak_force_n).tolist() == [False, True, False, True, True]
    assert len(detection.select_strong(records(v_m_s=v_m_s))) == 4


def test_a_touch_down_without_a_tick_in_5_ms_was_slept_through():
    touch_down_s, tick_t_s = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.005, 1.006, 2.0])
    assert detection.is_slept_through(touch_down_s, tick_t_s).tolist() == [False, True, False, True]
