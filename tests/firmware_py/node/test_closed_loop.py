"""The firmware on the simulated module, by frames: the default run, and what it does when things break."""

import math
from pathlib import Path

import numpy as np
import pytest
from closed_loop import Bench, scene_with

import hil
from firmware_py.interface.enums import (
    ActingLimit,
    Fault,
    Mode,
    OperatorRequest,
    Refusal,
    Regime,
)
from firmware_py.interface.frame import Frame
from firmware_py.interface.modes import MOVING

HIT_M_S = 0.05


@pytest.fixture(scope="module")
def default_run() -> Bench:
    """From rest to r = 1.3, held, stopped; shortened; interpreted, as a run is by default."""
    bench = Bench(build="python").started()
    bench.run(16.0)
    bench.request = OperatorRequest.IDLE
    bench.run(3.0)
    return bench


def times(bench: Bench) -> np.ndarray:
    return np.array([m.t_s for m in bench.motions])


@pytest.mark.requirement("P-01", "P-02", "P-12")
def test_the_ramp_captures_what_an_instant_start_cannot(default_run: Bench) -> None:
    modes = [o.mode for o in default_run.outputs]
    order = [mode for k, mode in enumerate(modes) if k == 0 or modes[k - 1] != mode]
    assert order == [Mode.READY, Mode.SOFT_START, Mode.RUN, Mode.STOPPING, Mode.READY]
    assert default_run.outputs[-1].fault == Fault.NONE
    run = modes.index(Mode.RUN)
    assert default_run.outputs[run + 4000].regime == Regime.IMPACT
    steady = [v for t, v in default_run.touch_downs if 11.0 < t < 16.0]
    assert np.mean(steady) == pytest.approx(0.91, abs=0.02)


@pytest.mark.requirement("P-05")
def test_the_estimate_follows_the_truth(default_run: Bench) -> None:
    t = times(default_run)
    window = (t > 10.0) & (t < 16.0)
    x = default_run.column(lambda s, _, m: s.estimator.x_m - m.x_m)[window]
    v = default_run.column(lambda s, _, m: s.estimator.v_m_s - m.v_m_s)[window]
    assert math.sqrt(np.mean(x * x)) < 0.4e-3
    assert math.sqrt(np.mean(v * v)) < 0.003
    assert default_run.states[15000].estimator.bias_m_s2 == pytest.approx(0.02 * 9.80665, abs=0.02)


def test_the_estimate_knows_how_good_it_is(default_run: Bench) -> None:
    """Innovations are as large as expected, and the error stays within what the spread says."""
    window = (times(default_run) > 10.0) & (times(default_run) < 16.0)
    nis = default_run.column(lambda s, _o, _m: s.estimator.nis)[window]
    assert 0.2 < nis[nis > 0.0].mean() < 1.5
    x = default_run.column(lambda s, _, m: (s.estimator.x_m - m.x_m) ** 2 / s.estimator.p_xx)[window]
    assert x.mean() < 1.0


def test_a_module_that_is_not_the_nominal_one_is_lived_with() -> None:
    """−2 % c, +30 % b, −0.05 k, +1 mm l0, −0.3 mm stop, 50 mg of bias."""
    scene = scene_with(
        striker={"spring_n_m": 68.6, "rest_length_m": 0.121},
        friction={"law": "viscous", "b_n_s_m": 0.26},
        stop={"position_m": 0.1797, "restitution": 0.45},
        sensors={"striker_low": {"bias_m_s2": 0.49}},
    )
    bench = Bench(scene=scene, ratio=1.1).started()
    bench.run(12.0)
    window = times(bench) > 8.0
    x = bench.column(lambda s, _, m: s.estimator.x_m - m.x_m)[window]
    v = bench.column(lambda s, _, m: s.estimator.v_m_s - m.v_m_s)[window]
    assert math.sqrt(np.mean(x * x)) < 0.9e-3
    assert math.sqrt(np.mean(v * v)) < 0.010
    nees = bench.column(lambda s, _, m: (s.estimator.x_m - m.x_m) ** 2 / s.estimator.p_xx)[window]
    assert nees.mean() < 9.0
    nis = bench.column(lambda s, _o, _m: s.estimator.nis)[window]
    assert 0.2 < nis[nis > 0.0].mean() < 4.0
    assert bench.node.outputs.regime == Regime.IMPACT


@pytest.mark.requirement("P-06")
def test_every_impact_is_found_once_and_soon(default_run: Bench) -> None:
    found = times(default_run)[[o.impact for o in default_run.outputs]]
    true = np.array([t for t, v in default_run.touch_downs if v >= HIT_M_S])
    assert len(found) == len(true)
    latency = found - true
    assert latency.min() > 0.0
    assert np.median(latency) < 1.2e-3
    assert latency.max() < 3e-3


def test_age_speed_and_impulse_of_a_impact(default_run: Bench) -> None:
    t = times(default_run)
    true = [(a, v) for a, v in default_run.touch_downs if 10.0 < a < 15.0]
    touched = [k for k, o in enumerate(default_run.outputs) if o.impact and 10.0 < t[k] < 15.0]
    left = [k for k, o in enumerate(default_run.outputs) if o.separation and 10.0 < t[k] < 15.0]
    for k, (at, v) in zip(touched, true, strict=True):
        outputs = default_run.outputs[k]
        assert t[k] - outputs.impact_age_s == pytest.approx(at, abs=5e-4)
        assert outputs.impact_speed_m_s == pytest.approx(v, abs=0.03)
    for k in left:
        assert default_run.outputs[k].impact_impulse_n_s == pytest.approx(0.8 * 0.91 * 1.5, rel=0.03)


@pytest.mark.requirement("P-04")
def test_the_speed_is_held_and_the_torque_within_its_limit(default_run: Bench) -> None:
    t = times(default_run)
    omega = default_run.column(lambda _s, _o, m: m.omega_rad_s)[(t > 10.0) & (t < 16.0)]
    assert omega.std() / omega.mean() < 0.002
    assert omega.mean() == pytest.approx(1.3 * 9.354143, rel=1e-3)
    torque = default_run.column(lambda _s, o, _m: o.torque_n_m)
    assert np.abs(torque).max() < 0.2


@pytest.mark.requirement("P-04")
@pytest.mark.parametrize("counts", [22, 24, 31])
def test_at_whole_counts_of_the_encoder_in_a_period_the_ripple_is_the_stated_one(
    counts: int, tmp_path: Path
) -> None:
    ratio = counts * math.tau / 16384 / 1e-3 / math.sqrt(70.0 / 0.8)
    changed = {"script.commands.0.target_ratio": ratio}
    run = hil.run("soft-start-multistable", set=changed, out=tmp_path / "run")
    [check] = [one for one in run.verdict["checks"] if one["name"] == "speed.ripple"]
    assert check["passed"]
    assert check["limit"] == "≤ 0.003"
    assert check["value"] > 0.0015


@pytest.mark.requirement("P-03")
def test_no_impact_on_the_way_is_harder_than_the_steady_ones(default_run: Bench) -> None:
    steady = max(v for t, v in default_run.touch_downs if 11.0 < t < 16.0)
    assert max(v for _, v in default_run.touch_downs) <= 1.05 * steady
    stopping = [v for t, v in default_run.touch_downs if t > 16.4]
    assert len(stopping) <= 4


def test_a_ratio_at_which_there_are_no_impacts_is_refused_after_the_second_loss() -> None:
    """Coulomb μ = 0.17 has its fold below r = 1.3; before, the speed asked for may still be had."""
    scene = scene_with(drive={"amplitude_m": 0.03}, friction={"law": "coulomb", "mu": 0.17})
    nominal = {
        "friction.mu": 0.15,
        "friction.b_n_s_m": 0.0,
        "drive.amplitude_m": 0.03,
        "hold.gain_phase": 0.01,
    }
    bench = Bench(nominal, scene, ratio=1.35).started()
    bench.run(24.0)
    seen = zip(bench.states, bench.outputs, strict=True)
    trying = [(s.start.attempts, o.refusal, o.acting_limit) for s, o in seen if o.mode in MOVING]
    assert {refusal for attempts, refusal, _ in trying if attempts < 2} == {Refusal.NONE}
    again = [(refusal, limit) for attempts, refusal, limit in trying if attempts == 2]
    assert set(again) == {(Refusal.RATIO_TOO_HIGH, ActingLimit.RETREAT)}


@pytest.mark.parametrize("ratio", [1.0, 1.35])
@pytest.mark.requirement("S-03")
def test_a_stop_ends_with_few_impacts_and_none_much_harder(ratio: float) -> None:
    bench = Bench({"start.rise_s": 2.0}, ratio=ratio).started()
    bench.run(9.0, keep=False)
    assert bench.node.outputs.mode == Mode.RUN
    at_s = 1e-3 * bench.tick
    bench.request = OperatorRequest.IDLE
    bench.run(3.0, keep=False)
    assert bench.node.outputs.mode == Mode.READY
    steady = max(v for t, v in bench.touch_downs if at_s - 3.0 < t <= at_s)
    after = [(t - at_s, v) for t, v in bench.touch_downs if t > at_s]
    assert len(after) <= 4
    assert max([t for t, _ in after], default=0.0) < 2.0
    assert max([v for _, v in after], default=0.0) < 1.03 * steady


def test_the_phase_of_the_impacts_is_that_of_the_branch(default_run: Bench) -> None:
    reports = [o for o in default_run.outputs[11000:16000] if o.period_ended]
    assert len(reports) >= 8
    for report in reports:
        assert report.period_impacts == 1
        assert math.degrees(report.impact_phase_rad) == pytest.approx(48.0, abs=4.0)


def test_an_impact_shorter_than_the_sampling_is_carried_across_by_newtons_law() -> None:
    bench = Bench({"stop.contact_s": 0.001}, scene_with(stop={"contact_s": 0.001})).started()
    bench.run(12.0)
    assert bench.node.outputs.mode == Mode.RUN
    t = times(bench)
    x = bench.column(lambda s, _, m: s.estimator.x_m - m.x_m)[t > 9.0]
    assert math.sqrt(np.mean(x * x)) < 2.5e-3


def test_an_impact_beyond_the_force_limit_stops_the_motor_however_short_it_is() -> None:
    bench = Bench({"stop.contact_s": 0.0005}, scene_with(stop={"contact_s": 0.0005})).started()
    bench.run(12.0)
    assert bench.node.outputs.fault == Fault.FORCE_LIMIT


def test_pauses_that_are_misjudged_by_a_tick_do_no_harm() -> None:
    """Of the samples in a pause only the last has come, and the loop counts a tick more or less.

    After the shortest pause, 8 ticks, a tick too many or too few is an eighth of the crank's speed.
    """
    rng = np.random.default_rng(11)
    starts = [6000 + 457 * number for number in range(10)]
    paused = {start + age for start in starts for age in range(int(rng.integers(8, 20)))}
    bench = Bench(overrun=lambda tick: tick in paused).started()
    in_time = bench.node.tick

    def misjudged(frames: list[Frame], elapsed_ticks: int) -> list[Frame]:
        if elapsed_ticks > 1:
            frames = list({frame.can_id: frame for frame in frames}.values())
            elapsed_ticks += int(rng.integers(-1, 2))
        return in_time(frames, elapsed_ticks)

    bench.node.tick = misjudged  # type: ignore[method-assign]
    bench.run(12.0)
    assert bench.node.outputs.fault == Fault.NONE
    assert bench.node.outputs.mode == Mode.RUN
    assert bench.node.outputs.regime == Regime.IMPACT
    moving = np.array([tick not in paused for tick in range(bench.tick)]) & (times(bench) > 7.0)
    speed = bench.column(lambda s, _, m: s.crank.omega_rad_s - m.omega_rad_s)[moving]
    assert np.abs(speed).max() < bench.motions[-1].omega_rad_s / 8.0
