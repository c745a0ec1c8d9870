"""The gait cycle's estimate on made-up walking, whose true phase is known."""

import math

import numpy as np
import pytest
from walker import HEEL_OFF, TOE_DOWN, TOE_OFF, Walk, walk

from firmware_py.core.gait import gait
from firmware_py.core.gait.gait import CycleState
from firmware_py.core.inputs import GaitInput
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import GaitState
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
TICKS = 5
STANDING = (0.0, True, True)


def fed(state: CycleState, rate_rad_s: float, heel: bool, toe: bool) -> CycleState:
    """One frame's five ticks."""
    for age in range(TICKS):
        state = gait.step(CONFIG.gait, state, GaitInput(rate_rad_s, heel, toe, age))
    return state


def followed(walked: Walk, state: CycleState = gait.INITIAL) -> list[CycleState]:
    """The state in the tick of each frame."""
    seen = []
    for rate, heel, toe in zip(
        walked.rate_rad_s.tolist(), walked.heel.tolist(), walked.toe.tolist(), strict=True
    ):
        state = gait.step(CONFIG.gait, state, GaitInput(rate, heel, toe, 0))
        seen.append(state)
        for age in range(1, TICKS):
            state = gait.step(CONFIG.gait, state, GaitInput(rate, heel, toe, age))
    return seen


def rmse(walked: Walk, states: list[CycleState]) -> float:
    """Of the phase from the eighth stride on, as a share of the cycle."""
    error = (np.array([state.phase for state in states]) - walked.phase + 0.5) % 1.0 - 0.5
    return math.sqrt(np.mean(error[walked.t_s > walked.strikes_s[8]] ** 2))


@pytest.mark.parametrize("stride_s", [0.95, 1.6, 2.2])
@pytest.mark.parametrize(
    ("spread", "missed", "changes", "limit"),
    [(0.02, 0.0, False, 0.02), (0.04, 0.0, False, 0.02), (0.02, 0.05, False, 0.02), (0.03, 0.02, True, 0.04)],
)
@pytest.mark.requirement("P-10")
def test_the_phase_is_known_to_2_percent_steady_and_4_percent_varied(
    stride_s: float, spread: float, missed: float, changes: bool, limit: float
) -> None:
    walked = walk(np.random.default_rng(3), stride_s, spread, 50, changes, missed)
    states = followed(walked)
    assert rmse(walked, states) < limit
    trusted = np.array([state.confidence for state in states])[walked.t_s > walked.strikes_s[8]]
    assert np.mean(trusted > 0.25) > 0.98


def test_nothing_is_said_before_strides_have_been_seen() -> None:
    walked = walk(np.random.default_rng(1))
    states = followed(walked)
    early = [state for state, t in zip(states, walked.t_s, strict=True) if t < walked.strikes_s[3]]
    assert {state.confidence for state in early} == {0.0}
    assert {state.doing for state in early} <= {GaitState.UNCERTAIN, GaitState.STANDING}


def test_stance_and_swing_are_distinguished() -> None:
    walked = walk(np.random.default_rng(1), timing=0.0)
    states = followed(walked)
    settled = [(s.doing, p) for s, p, t in zip(states, walked.phase, walked.t_s, strict=True) if t > 12.0]
    assert all(leg == GaitState.STANCE for leg, phase in settled if 0.02 < phase < 0.59)
    assert all(leg == GaitState.SWING for leg, phase in settled if 0.61 < phase < 0.99)


def test_irregular_strides_are_trusted_less() -> None:
    def mean(spread: float) -> float:
        return float(np.mean([s.confidence for s in followed(walk(np.random.default_rng(5), spread=spread))]))

    assert mean(0.01) > mean(0.04) > mean(0.10)
    assert mean(0.10) < 0.3


def test_a_missed_heel_strike_is_bridged_and_trusted_less() -> None:
    walked = walk(np.random.default_rng(1), spread=0.0, timing=0.0, noise_rad_s=0.0)
    missing = (walked.t_s > walked.strikes_s[20] - 0.01) & (walked.t_s < walked.strikes_s[21] - 0.01)
    walked = walked._replace(heel=walked.heel & ~missing, toe=walked.toe & ~missing)
    states = followed(walked)
    assert rmse(walked, states) < 0.02
    at = [walked.strikes_s[20] + share * 1.15 for share in (-0.5, 0.5, 1.5)]
    before, bridged, after = (states[int(np.searchsorted(walked.t_s, t))] for t in at)
    assert (before.stride.missed, bridged.stride.missed, after.stride.missed) == (0, 1, 0)
    assert bridged.confidence == pytest.approx(0.5 * before.confidence, rel=0.05)


def test_who_stops_is_not_trusted_within_a_third_of_a_second_and_stands_after_a_second() -> None:
    state = followed(walk(np.random.default_rng(1), count=12))[-1]
    assert state.confidence > 0.25
    for _ in range(60):
        state = fed(state, *STANDING)
    assert state.confidence == 0.0
    assert state.doing == GaitState.UNCERTAIN
    for _ in range(200):
        state = fed(state, *STANDING)
    assert state.doing == GaitState.STANDING


def test_frames_that_stop_coming_end_all_trust() -> None:
    state = followed(walk(np.random.default_rng(1), count=12))[-1]
    for age in range(5, CONFIG.gait.silent_ticks + 1):
        state = gait.step(CONFIG.gait, state, GaitInput(0.5, True, True, age))
    assert state.confidence > 0.25
    for age in range(CONFIG.gait.silent_ticks + 1, CONFIG.gait.silent_ticks + 3):
        state = gait.step(CONFIG.gait, state, GaitInput(0.5, True, True, age))
    assert state.confidence == 0.0


def test_a_heel_that_bounces_makes_no_stride() -> None:
    """A switch that opens and closes again while the leg has not swung."""
    state = followed(walk(np.random.default_rng(1), count=12))[-1]
    known = state.stride.known
    for heel in (True, False, True, False, True):
        state = fed(state, 1.5, heel, False)
    assert state.stride.known == known + 1


def test_switches_that_bounce_report_no_events() -> None:
    """Both open and close again within 8 ms of each change, as they like."""
    rng = np.random.default_rng(4)
    walked = walk(np.random.default_rng(3), count=50)

    def bouncing(closed: np.ndarray) -> np.ndarray:
        changed = np.flatnonzero(np.diff(closed.astype(int))) + 2
        shaken = closed.copy()
        shaken[np.minimum(changed, len(closed) - 1)] = rng.random(len(changed)) < 0.5
        return shaken

    states = followed(walked._replace(heel=bouncing(walked.heel), toe=bouncing(walked.toe)))
    assert rmse(walked, states) < 0.02
    events = states[-1].events
    learnt = [event.phase for event in (events.toe_down, events.heel_off, events.toe_off)]
    assert learnt == pytest.approx([TOE_DOWN, HEEL_OFF, TOE_OFF], abs=0.02)


def test_a_heel_that_lifts_in_the_frame_in_which_the_toes_come_down_is_an_event_too() -> None:
    """One frame shows both switches, and so the edges of both; they are equally old."""
    walked = walk(np.random.default_rng(1), count=20, spread=0.0, timing=0.0)
    tipped = walked._replace(
        heel=walked.heel & (walked.phase < 0.25), toe=walked.toe & (walked.phase >= 0.25)
    )
    events = followed(tipped)[-1].events
    assert events.toe_down.phase == pytest.approx(0.25, abs=0.005)
    assert events.heel_off.phase == pytest.approx(0.25, abs=0.005)


def test_a_foot_that_comes_down_early_ends_all_trust() -> None:
    """Tripped: the toes come down at half of their time."""
    walked = walk(np.random.default_rng(1), count=20, spread=0.0)
    strike_s = walked.strikes_s[15]
    early = (walked.t_s > strike_s + 0.07 * 1.15) & (walked.t_s < strike_s + 0.2 * 1.15)
    states = followed(walked._replace(toe=walked.toe | early))
    at = int(np.searchsorted(walked.t_s, strike_s + 0.07 * 1.15))
    assert states[at - 2].confidence > 0.5
    assert states[at + 2].confidence == 0.0


def test_a_stride_unlike_all_others_begins_anew() -> None:
    walked = walk(np.random.default_rng(1), count=12, spread=0.0)
    state = followed(walked)[-1]
    again = walk(np.random.default_rng(1), count=2, stride_s=0.7, spread=0.0)
    assert state.confidence > 0.5
    assert followed(again, state)[-1].confidence == 0.0


def test_time_that_is_never_fed_stays_bounded() -> None:
    state = gait.INITIAL
    for _ in range(100):  # it begins at the bound
        state = gait.step(CONFIG.gait, state, GaitInput(0.0, True, True, NEVER_TICKS))
    assert state.stride.since_s == state.stride.since_seen_s == gait.LONGEST_S
    assert state.doing == GaitState.STANDING
