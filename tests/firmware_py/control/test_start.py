import numpy as np
import pytest

from firmware_py.core.control import start
from firmware_py.core.control.start import Stage
from firmware_py.core.estimation import regime
from firmware_py.core.estimation.regime import Period
from firmware_py.core.request import Request
from firmware_py.interface.enums import Mode, Refusal
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
NATURAL_RAD_S = CONFIG.nominal.natural_rad_s
GOAL = zeroed(Request, ratio=1.3, refusal=Refusal.NONE, unmet=Refusal.NONE)
QUIET = regime.INITIAL


def periods(hit: bool) -> regime.RegimeState:
    return regime.INITIAL._replace(ended=True, last=Period(1 if hit else 0, 0.9, 0.0, 300.0))


def until(
    state: start.StartState,
    seconds: float,
    mode: Mode = Mode.SOFT_START,
    ratio: float = 1.3,
    hits: bool = True,
    trim: float = 0.0,
    may_retreat: bool = True,
) -> tuple[start.StartState, np.ndarray]:
    """Run with a drive period of 0.5 s that has an impact or not; targets as followed."""
    targets = []
    for tick in range(round(seconds * 1000)):
        seen = periods(hits) if tick % 500 == 499 else QUIET
        goal = GOAL._replace(ratio=ratio, trim=trim, sets_hold_ratio=not may_retreat)
        state = start.step(CONFIG.p, CONFIG.nominal, state, mode, goal, True, state.target_omega_rad_s, seen)
        targets.append(state.target_omega_rad_s)
    return state, np.array(targets)


def test_the_s_curve_starts_and_ends_flat_and_never_turns_back() -> None:
    s = np.linspace(-0.5, 1.5, 2001)
    height, slope = np.array([start.s_curve(float(x)) for x in s]).T
    assert height[0] == 0.0
    assert height[-1] == 1.0
    assert start.s_curve(0.5) == (0.5, 1.5)
    assert np.all(np.diff(height) >= 0.0)
    np.testing.assert_allclose(np.gradient(height, s)[1:-1], slope[1:-1], atol=5e-3)
    assert slope.max() == 1.5
    assert slope[np.searchsorted(s, 0.0)] == pytest.approx(0.0, abs=1e-12)


def test_the_rise_reaches_the_target_in_its_time_without_overshoot() -> None:
    state, targets = until(start.INITIAL, 5.8, hits=False)
    goal, near = (
        1.3 * NATURAL_RAD_S,
        CONFIG.p.start.approach_ratio * NATURAL_RAD_S,
    )
    assert targets[-1] == pytest.approx(goal, rel=1e-12)
    assert np.all(np.diff(targets) >= 0.0)
    assert np.searchsorted(targets, near * (1 - 1e-9)) == pytest.approx(
        1e3 * CONFIG.p.start.approach_s, abs=5
    )
    whole_s = CONFIG.p.start.approach_s + CONFIG.p.start.rise_s
    assert np.searchsorted(targets, goal * (1 - 1e-9)) == pytest.approx(1e3 * whole_s, abs=5)
    steepest = 1e3 * np.diff(targets)[round(1e3 * CONFIG.p.start.approach_s) + 5 :].max()
    assert steepest == pytest.approx(1.5 * (goal - near) / CONFIG.p.start.rise_s, rel=1e-2)
    assert state.stage == Stage.CONFIRM


def test_a_fast_crank_is_first_brought_below_resonance() -> None:
    freewheel_overspeed = 1.2 * NATURAL_RAD_S
    state = start.step(
        CONFIG.p, CONFIG.nominal, start.INITIAL, Mode.SOFT_START, GOAL, True, freewheel_overspeed, QUIET
    )
    assert state.stage == Stage.APPROACH
    assert state.target_omega_rad_s == freewheel_overspeed
    _, targets = until(state, CONFIG.p.start.approach_s, hits=False)
    assert targets[-1] == pytest.approx(CONFIG.p.start.approach_ratio * NATURAL_RAD_S, rel=1e-3)


def test_a_rise_that_is_quicker_than_the_approach_goes_straight_to_its_target() -> None:
    quick = config_from({"start.rise_s": 0.1})
    assert start.begin_start(quick.p, quick.nominal, 0.0, 12.0).stage == Stage.RISE


def test_impacts_in_consecutive_periods_capture() -> None:
    state, _ = until(start.INITIAL, 8.0)
    assert state.captured
    assert state.stage == Stage.HOLD


def test_below_the_onset_of_impacts_none_are_waited_for() -> None:
    state, _ = until(start.INITIAL, 5.2, ratio=0.6, hits=False)
    assert state.captured


def dips_of(targets: np.ndarray) -> int:
    """How often the targets came down to the dip."""
    return np.count_nonzero(
        np.diff((targets < (CONFIG.p.start.dip_ratio + 1e-9) * NATURAL_RAD_S).astype(int)) == 1
    )


def test_a_failed_capture_dips_and_then_gives_up_within_30_s() -> None:
    """Without an impact in the dip either, one dip counts as two."""
    state, targets = until(start.INITIAL, 30.0, hits=False)
    assert state.failed
    assert not state.captured
    assert state.attempts >= CONFIG.p.start.attempts
    assert dips_of(targets) == (CONFIG.p.start.attempts + 1) // 2
    frozen, _ = until(state, 1.0)
    assert frozen == state


def test_each_loss_ends_the_next_curve_a_longer_step_lower() -> None:
    state, _ = until(start.INITIAL, 8.0, ratio=1.2)
    ends = []
    while not state.failed:
        state, _ = until(state, 1.1, Mode.RUN, ratio=1.2, hits=False)
        state, targets = until(state, 5.5, Mode.RUN, ratio=1.2)
        ends.append(targets[-1] / NATURAL_RAD_S)
    assert ends[: CONFIG.p.start.attempts] == pytest.approx([1.17, 1.11, CONFIG.p.start.dip_ratio], rel=1e-9)
    assert state.attempts == CONFIG.p.start.attempts


def test_what_has_held_for_long_is_tried_again_where_it_was_once() -> None:
    state, _ = until(start.INITIAL, 14.0, ratio=1.2)
    ends = []
    for _ in range(2):
        state, _ = until(state, 1.1, Mode.RUN, ratio=1.2, hits=False)
        state, targets = until(state, 5.5, Mode.RUN, ratio=1.2)
        ends.append(targets[-1] / NATURAL_RAD_S)
    assert ends == pytest.approx([1.2, 1.14], rel=1e-9)


def test_a_loss_in_the_hold_counts_from_where_the_hold_had_gone() -> None:
    state, _ = until(start.INITIAL, 8.0, ratio=1.2)
    state, targets = until(state, 1.0, Mode.RUN, ratio=1.2, trim=-0.05)
    assert targets[-1] == pytest.approx(1.15 * NATURAL_RAD_S)
    state, targets = until(state, 1.1, Mode.RUN, ratio=1.2, hits=False, trim=-0.05)
    assert state.stage == Stage.DIP
    assert targets.max() == pytest.approx(1.15 * NATURAL_RAD_S)
    assert start.has_retreated(CONFIG.p, CONFIG.nominal, state, 1.2)
    state, targets = until(state, 6.0, Mode.RUN, ratio=1.2)
    assert targets[-1] == pytest.approx(1.12 * NATURAL_RAD_S)
    assert start.has_retreated(CONFIG.p, CONFIG.nominal, state, 1.2)
    # The hold leads back to what was asked for; then nothing holds it off.
    state, _ = until(state, 0.1, Mode.RUN, ratio=1.2, trim=0.08)
    assert not start.has_retreated(CONFIG.p, CONFIG.nominal, state, 1.2)


def test_no_curve_ends_below_the_dip_and_a_ratio_below_it_is_kept() -> None:
    state, _ = until(start.INITIAL, 8.0, ratio=1.06)
    state, _ = until(state, 2.0, Mode.RUN, ratio=1.06, hits=False)
    state, targets = until(state, 9.0, Mode.RUN, ratio=1.06)
    assert targets[-1] == pytest.approx(CONFIG.p.start.dip_ratio * NATURAL_RAD_S)
    state, _ = until(start.INITIAL, 8.0, ratio=0.95)
    state, _ = until(state, 2.0, Mode.RUN, ratio=0.95, hits=False)
    state, targets = until(state, 9.0, Mode.RUN, ratio=0.95)
    assert targets[-1] == pytest.approx(0.95 * NATURAL_RAD_S)
    assert not start.has_retreated(CONFIG.p, CONFIG.nominal, state, 0.95)


def test_a_speed_that_the_gait_sets_is_not_retreated_from() -> None:
    state, _ = until(start.INITIAL, 8.0, ratio=1.2)
    state, _ = until(state, 2.0, Mode.RUN, ratio=1.2, hits=False, may_retreat=False)
    state, targets = until(state, 9.0, Mode.RUN, ratio=1.2, may_retreat=False)
    assert targets[-1] == pytest.approx(1.2 * NATURAL_RAD_S)


def test_a_lost_regime_is_recaptured() -> None:
    state, _ = until(start.INITIAL, 8.0)
    state, _ = until(state, 2.0, Mode.RUN, hits=False)
    assert state.stage in (Stage.DIP, Stage.DWELL)
    assert not state.captured
    state, targets = until(state, 9.0, Mode.RUN)
    assert state.captured
    assert targets.min() == pytest.approx(CONFIG.p.start.dip_ratio * NATURAL_RAD_S, rel=1e-9)
    assert targets[-1] == pytest.approx(1.27 * NATURAL_RAD_S, rel=1e-9)
    state, _ = until(state, 30.0, Mode.RUN)
    assert state.attempts == 0


def test_a_new_target_is_approached_on_a_curve_of_its_own() -> None:
    state, _ = until(start.INITIAL, 8.0)
    state, targets = until(state, 3.0, Mode.RUN, ratio=1.1)
    assert targets[-1] == pytest.approx(1.1 * NATURAL_RAD_S, rel=1e-12)
    assert np.all(np.diff(targets) <= 0.0)
    assert state.captured


def test_stopping_goes_to_zero_in_its_time() -> None:
    state, _ = until(start.INITIAL, 8.0)
    state, targets = until(state, 2.1, Mode.STOPPING)
    assert targets[-1] == 0.0
    assert np.all(np.diff(targets) <= 0.0)
    assert np.count_nonzero(targets > 0.0) == pytest.approx(1000, abs=2)


def test_nothing_is_asked_for_until_the_drive_is_ready() -> None:
    state = start.step(CONFIG.p, CONFIG.nominal, start.INITIAL, Mode.SOFT_START, GOAL, False, 0.0, QUIET)
    assert state == start.INITIAL


@pytest.mark.parametrize("mode", [Mode.INIT, Mode.READY, Mode.FAULT, Mode.E_STOP])
def test_modes_without_motion_forget_everything(mode: Mode) -> None:
    state, _ = until(start.INITIAL, 6.0)
    assert start.step(CONFIG.p, CONFIG.nominal, state, mode, GOAL, True, 12.0, QUIET) == start.INITIAL


@pytest.mark.parametrize(("ratio", "valid"), [(1.3, True), (0.0, False), (3.0, False), (float("nan"), False)])
def test_ratios_that_can_be_run(ratio: float, valid: bool) -> None:
    assert start.is_valid_ratio(CONFIG.p, ratio) is valid


def test_a_start_onto_a_turning_crank_begins_at_its_speed() -> None:
    state = start.step(CONFIG.p, CONFIG.nominal, start.INITIAL, Mode.SOFT_START, GOAL, True, 3.0, QUIET)
    assert state.target_omega_rad_s == 3.0
