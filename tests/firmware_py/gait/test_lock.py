"""The crank locked to the gait: how many turns a stride, the window, and the whole firmware on a walk."""

import math

import numpy as np
import pytest
from closed_loop import Bench
from walker import PERIOD_S, Walk, walk

from firmware_py.core.estimation.regime import INITIAL as NO_REGIME
from firmware_py.core.gait import gait, gait_lock
from firmware_py.core.gait.gait_lock import LockState, Moment
from firmware_py.interface import codec
from firmware_py.interface.enums import GaitState, Mode, Refusal
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import GaitReport, GaitSensors
from firmware_py.shell.parameters import config_from

FOLLOW = {"gait.follow": 1}
CONFIG = config_from(FOLLOW)
NATURAL_RAD_S = CONFIG.nominal.natural_rad_s
NATURAL_HZ = NATURAL_RAD_S / (2.0 * math.pi)
HOLDING = Moment(
    moving=True,
    holding=True,
    angle_rad=0.0,
    regime=NO_REGIME,
    touch_down=False,
    since_touch_down_s=0.0,
    impact_n_s=0.0,
)


def stride_for(ratio: float, harmonic: int) -> float:
    """The stride that `harmonic` turns at `ratio` take."""
    return harmonic / (ratio * NATURAL_HZ)


def cycle(stride_s: float, phase: float = 0.5, confidence: float = 0.9) -> gait.CycleState:
    stride = gait.INITIAL.stride._replace(mean_s=stride_s, expected_s=stride_s)
    return gait.INITIAL._replace(phase=phase, confidence=confidence, stride=stride)


def stepped(state: LockState, seen: gait.CycleState, angle_rad: float = 0.0, ticks: int = 1) -> LockState:
    for _ in range(ticks):
        state = gait_lock.step(CONFIG.gait, state, seen, HOLDING._replace(angle_rad=angle_rad), 0.0)
    return state


def test_the_turns_that_are_nearest_to_the_centre_are_taken() -> None:
    few = [stride_for(ratio, harmonic) for ratio in (0.99, 1.12, 1.29) for harmonic in (1, 2)]
    for stride_s in [*few, *np.linspace(3.0, 9.0, 50)]:
        harmonic = gait_lock.choose_turns(CONFIG.gait, float(stride_s), 0, 0.0)
        ratio = harmonic / (stride_s * NATURAL_HZ)
        others = [other / (stride_s * NATURAL_HZ) for other in range(1, 20)]
        assert abs(ratio - CONFIG.p.gait.centre_ratio) == pytest.approx(
            min(abs(other - CONFIG.p.gait.centre_ratio) for other in others)
        )


def test_where_no_whole_number_of_turns_lies_in_the_region_there_is_none() -> None:
    assert gait_lock.choose_turns(CONFIG.gait, stride_for(0.90, 1), 0, 0.0) == 0
    assert gait_lock.choose_turns(CONFIG.gait, stride_for(0.90, 2), 0, 0.0) == 0
    assert gait_lock.choose_turns(CONFIG.gait, 100.0, 0, 0.0) == 0
    assert gait_lock.find_refusal(CONFIG.gait, cycle(1.0), 0) == Refusal.NO_HARMONIC


def test_turns_once_taken_are_kept_until_others_are_clearly_better() -> None:
    """Five and six are equally near where r changes from a sixth to a fifth about the centre."""
    even = 2.0 * CONFIG.p.gait.centre_ratio / (5.0 + 6.0)
    up = [
        gait_lock.choose_turns(CONFIG.gait, 1.0 / (one * NATURAL_HZ), 6, 0.0)
        for one in (even, even * 1.02, even * 1.04)
    ]
    down = [
        gait_lock.choose_turns(CONFIG.gait, 1.0 / (one * NATURAL_HZ), 5, 0.0)
        for one in (even, even * 0.98, even * 0.96)
    ]
    assert up == [6, 6, 5]
    assert down == [5, 5, 6]


def test_turns_once_taken_may_leave_the_region_a_little() -> None:
    assert gait_lock.choose_turns(CONFIG.gait, stride_for(0.97, 2), 0, 0.0) == 0
    assert gait_lock.choose_turns(CONFIG.gait, stride_for(0.95, 2), 2, 0.0) == 2
    assert gait_lock.choose_turns(CONFIG.gait, stride_for(0.93, 2), 2, 0.0) == 0


def test_nothing_is_followed_that_is_not_trusted() -> None:
    state = stepped(gait_lock.INITIAL, cycle(stride_for(1.1, 2), confidence=0.2))
    assert (state.harmonic, state.refusal) == (0, Refusal.NOT_WALKING)


def test_the_ratio_changes_by_its_rate_at_most() -> None:
    start = gait_lock.INITIAL._replace(base_ratio=1.0)
    state = stepped(start, cycle(stride_for(1.2, 2)), ticks=100)
    assert state.trim == pytest.approx(0.1 * CONFIG.p.gait.rate_1_s)
    assert state.trim_rate_1_s == pytest.approx(CONFIG.p.gait.rate_1_s)


def test_a_crank_that_lags_is_led_forward_and_one_ahead_back() -> None:
    """At the window's middle the crank has to be where impacts come: at 90° here."""
    seen = cycle(stride_for(1.1, 2), phase=0.5 * (CONFIG.p.gait.window_start + CONFIG.p.gait.window_end))
    start = gait_lock.INITIAL._replace(base_ratio=1.1)
    behind, ahead = (stepped(start, seen, angle, 1000) for angle in (1.4, 1.74))
    assert behind.error_rad == pytest.approx(0.5 * math.pi - 1.4)
    assert behind.trim == pytest.approx(CONFIG.p.gait.gain_1_s * behind.error_rad / NATURAL_RAD_S)
    assert ahead.trim == pytest.approx(CONFIG.p.gait.gain_1_s * ahead.error_rad / NATURAL_RAD_S)
    assert behind.trim > 0.0 > ahead.trim


def test_other_turns_are_taken_so_far_before_the_window_as_the_change_of_speed_costs() -> None:
    before, after = stride_for(1.12, 2), stride_for(1.12, 3)
    share = gait_lock.turning_share(CONFIG.gait, after)
    # From two turns to three: the crank is late by ω Δr²/2ρ, which a leap of 2π in θ* by cycle stands for.
    step = 1.12 / 3.0
    lost_rad = NATURAL_RAD_S * step**2 / (2.0 * CONFIG.p.gait.rate_1_s)
    assert 2.0 * math.pi * share == pytest.approx(lost_rad)
    change_at = 0.525 - share
    state = stepped(gait_lock.INITIAL, cycle(before, phase=change_at + 0.1))
    assert state.harmonic == 2
    for phase in (change_at + 0.2, 0.9, 0.0, change_at - 0.01):
        state = stepped(state, cycle(after, phase=phase))
        assert state.harmonic == 2
    assert stepped(state, cycle(after, phase=change_at + 0.001)).harmonic == 3


def test_pulses_are_counted_in_and_out_of_the_window() -> None:
    def counted(phase: float, age_s: float) -> tuple[int, int]:
        touched = HOLDING._replace(touch_down=True, since_touch_down_s=age_s)
        walking = cycle(stride_for(1.1, 2), phase)
        state = gait_lock.step(CONFIG.gait, gait_lock.INITIAL, walking, touched, 0.0)
        return state.in_window, state.outside

    assert counted(0.5, 0.0) == (1, 0)
    assert counted(0.65, 0.0) == (0, 1)
    assert counted(0.61, 0.05) == (1, 0)
    assert counted(0.01, 0.05) == (0, 1)


class Walked(Bench):
    """The bench with somebody on it who walks, and then stands."""

    def follow(self, walked: Walk) -> "Walked":
        self.reports: list[GaitReport] = []

        def with_gait(tick: int, frames: list[Frame]) -> list[Frame]:
            # A tick later than the node sent it.
            for sent in self.sent:
                if sent.can_id == codec.GAIT_REPORT.can_id:
                    self.reports.append(codec.GAIT_REPORT.decode(sent.data))
            if tick % 5:
                return frames
            row = round((tick * 1e-3 - walked.t_s[0]) / PERIOD_S)
            rate, heel, toe = 0.0, True, True
            if 0 <= row < len(walked.t_s):
                rate, heel, toe = (float(walked.rate_rad_s[row]), walked.heel[row], walked.toe[row])
            sensors = GaitSensors(rate, 9.8, int(heel), int(toe))
            return [*frames, codec.GAIT_SENSORS.encode(sensors, tick // 5)]

        self.change = with_gait
        return self


@pytest.fixture(scope="module")
def run() -> tuple[Walked, Walk]:
    """Walking at 0.8 Hz, RUN asked for at once, two turns a stride; a stop at 40 s."""
    walked = walk(np.random.default_rng(2), stride_s=1.25, spread=0.02, count=32)
    bench = Walked(FOLLOW).follow(walked)
    bench.started()
    bench.run(45.0)
    return bench, walked


def test_it_reports_what_it_does(run: tuple[Walked, Walk]) -> None:
    bench, _ = run
    steady = [report for report in bench.reports if report.harmonic == 2]
    assert steady[-1].pulses_in_window >= 15
    assert 15 <= steady[-1].pulses_outside <= 28
    assert steady[-1].stride_hz == pytest.approx(0.8, abs=0.04)
    assert {report.gait_state for report in steady} == {GaitState.STANCE, GaitState.SWING}
    assert bench.reports[-1].gait_state == GaitState.STANDING
    assert len(bench.reports) == pytest.approx(bench.tick / 40, rel=0.02)


@pytest.mark.requirement("S-12")
def test_who_stands_still_stops_it_and_walking_alone_does_not_start_it_again(
    run: tuple[Walked, Walk],
) -> None:
    bench, walked = run
    end_s = walked.strikes_s[-1]
    modes = [o.mode for o in bench.outputs]
    stopping = modes.index(Mode.STOPPING) * 1e-3
    assert end_s < stopping < end_s + 0.4
    after = [t for t, _ in bench.touch_downs if t > end_s]
    assert max(after, default=end_s) < end_s + 2.0
    assert bench.outputs[-1].mode == Mode.READY
    assert bench.outputs[-1].refusal == Refusal.NOT_WALKING
    again = walk(np.random.default_rng(5), stride_s=1.25, count=8)
    bench.follow(again._replace(t_s=again.t_s + bench.tick * 1e-3))
    bench.run(8.0, keep=False)
    assert bench.node.state.gait.confidence > 0.25
    assert bench.node.outputs.mode == Mode.READY
    assert bench.asked_again() == Mode.SOFT_START


def test_a_walk_without_whole_turns_in_the_region_is_refused() -> None:
    bench = Walked(FOLLOW).follow(walk(np.random.default_rng(1), stride_s=0.9, count=12)).started()
    bench.run(8.0, keep=False)
    assert bench.node.outputs.mode == Mode.READY
    assert bench.node.outputs.refusal == Refusal.NO_HARMONIC


def test_gait_sensors_change_nothing_where_they_are_not_followed() -> None:
    """The same run with and without them: the same outputs, and a report where they are received."""
    walked = walk(np.random.default_rng(1), stride_s=0.75, count=12)
    plain, watched = Bench({"start.rise_s": 2.0}, ratio=1.1), Walked({"start.rise_s": 2.0}, ratio=1.1)
    watched.follow(walked)
    seen: set[int] = set()

    def listening(_: int, frames: list[Frame]) -> list[Frame]:
        seen.update(frame.can_id for frame in plain.sent)
        return frames

    plain.change = listening
    for bench in (plain, watched):
        bench.started()
        bench.run(5.0)
    assert plain.outputs == watched.outputs
    assert plain.node.state.gait == gait.INITIAL
    assert watched.node.state.gait.confidence > 0.25
    assert watched.node.state.gait_lock == gait_lock.INITIAL
    assert len(watched.reports) > 100
    assert codec.STRIKER_ESTIMATE.can_id in seen
    assert codec.GAIT_REPORT.can_id not in seen
