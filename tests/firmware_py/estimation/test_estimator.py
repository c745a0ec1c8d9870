import math

import numpy as np
import pytest
from scipy.linalg import expm

from firmware_py.core.config import Config
from firmware_py.core.estimation import (
    accelerometer,
    crank,
    estimator,
    estimator_state,
    newton,
    striker_model,
)
from firmware_py.core.estimation.estimator_state import Contact, EstimatorState
from firmware_py.core.estimation.kalman import Covariance, StateEstimate
from firmware_py.core.inputs import AccelerometerInput
from firmware_py.core.measurements import NOTHING_MEASURED, Measurement, Measurements
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import ContactPhase
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

FREE = Contact(False, False, 0.0, 0.0, measured=True, settled=True)
EXACT_SENSOR = {"sensor.bandwidth_hz": 1e5}


def tick(
    config: Config,
    state: EstimatorState,
    reading: float,
    angle_rad: float = 0.0,
    contact: Contact = FREE,
    age: int = 0,
    high: float | None = None,
    phase: ContactPhase = ContactPhase.FREE,
    housing: float = 0.0,
    measured: Measurements = NOTHING_MEASURED,
) -> EstimatorState:
    sample = AccelerometerInput(reading, reading if high is None else high, housing, age)
    crank_now = crank.INITIAL._replace(angle_rad=angle_rad)
    predicted = estimator.propagate(config.estimator, config.nominal, state, sample, phase, crank_now)
    return estimator.correct(config.estimator, config.nominal, state, predicted, contact, measured, crank_now)


def rested(config: Config, ticks: int, reading: float = 0.0) -> EstimatorState:
    """The estimate after this number of ticks with one reading."""
    state = estimator_state.INITIAL
    for _ in range(ticks):
        state = tick(config, state, reading)
    return state


@pytest.mark.parametrize(
    ("stiffness", "damping"),
    [(87.5, 0.25), (87.5, 2 * math.sqrt(87.5)), (87.5, 60.0), (87.5, 0.0), (1.0, 2.0)],
)
def test_the_closed_form_is_the_matrix_exponential(stiffness: float, damping: float) -> None:
    f = striker_model.free_flight(stiffness, damping, 1e-3)
    reference = expm(np.array([[0.0, 1.0], [-stiffness, -damping]]) * 1e-3)
    np.testing.assert_allclose([[f.x_x, f.x_v], [f.v_x, f.v_v]], reference, rtol=1e-12)


def test_bias_is_found_at_rest() -> None:
    state = rested(config_from({}), 8000, 0.4)
    assert state.bias_m_s2 == pytest.approx(0.4, abs=0.01)
    assert state.x_m == pytest.approx(0.12, abs=2e-4)
    assert state.v_m_s == pytest.approx(0.0, abs=2e-3)


def test_free_vibration_is_followed_with_unknown_start_and_bias() -> None:
    config = config_from(EXACT_SENSOR)
    f = striker_model.free_flight(87.5, 0.25, 1e-3)
    x, v, state, errors = 0.03, 0.2, estimator_state.INITIAL, []
    for _ in range(8000):
        state = tick(config, state, -87.5 * x - 0.25 * v - 0.35)
        errors.append((state.x_m - 0.12 - x, state.v_m_s - v))
        x, v = f.x_x * x + f.x_v * v, f.v_x * x + f.v_v * v
    late = np.array(errors[-2000:])
    assert np.abs(late[:, 0]).max() < 3e-4
    assert np.abs(late[:, 1]).max() < 3e-3
    assert state.bias_m_s2 == pytest.approx(-0.35, abs=0.02)


def test_the_low_pass_delay_is_made_up_for() -> None:
    """A pulse through the low-pass: speed and place after it are those of the pulse itself."""
    w = 2 * math.pi * 400.0
    config = config_from({})
    contact = Contact(False, False, 0.0, 0.9, measured=True, settled=False)
    start = state = rested(config, 10)
    filtered, slope, steps, t = 0.0, 0.0, 200, 0.0
    for _ in range(30):
        for _ in range(steps):
            pulse = 200.0 * math.sin(math.pi * t / 0.010) if t < 0.010 else 0.0
            filtered += 1e-3 / steps * slope
            slope += 1e-3 / steps * (w * w * (pulse - filtered) - math.sqrt(2.0) * w * slope)
            t += 1e-3 / steps
        state = tick(config, state, filtered, contact=contact, high=filtered, phase=ContactPhase.CONTACT)
    area = 200.0 * 0.010 * 2.0 / math.pi
    dv = state.v_m_s - start.v_m_s
    assert dv == pytest.approx(area, rel=2e-3)
    assert state.x_m - start.x_m == pytest.approx(area * (0.030 - 0.005), rel=5e-3)


def test_the_high_range_takes_over_with_its_offset_removed() -> None:
    config = config_from({"sensor.high_offset_s": 0.05})
    state = estimator_state.INITIAL
    for _ in range(1000):
        state = tick(config, state, 1.0, high=3.0)
    assert state.sensor.high_offset_m_s2 == pytest.approx(2.0, abs=1e-3)
    clipped = tick(config, state, -156.9, high=-298.0)
    assert clipped.sensor.acceleration_m_s2 == pytest.approx(-300.0, abs=1e-3)
    assert not clipped.sensor.clipped
    assert tick(config, state, -156.9, high=-1961.0).sensor.clipped


@pytest.mark.parametrize("rail_m_s2", [156.9, -156.9])
def test_a_housing_at_its_rail_is_no_reading(rail_m_s2: float) -> None:
    """Where the housing's acceleration is not known, neither is the striker's against it."""
    config = config_from({})
    state = rested(config, 5)
    clipped = accelerometer.sense(
        config.estimator.sensing, state.sensor, AccelerometerInput(0.0, 0.0, rail_m_s2, 0)
    )
    assert clipped.missed_ticks == 1
    assert clipped.housing_m_s2 == state.sensor.housing_m_s2
    assert clipped.housing_offset_m_s2 == state.sensor.housing_offset_m_s2
    near = accelerometer.sense(
        config.estimator.sensing, state.sensor, AccelerometerInput(0.0, 0.0, 0.9 * rail_m_s2, 0)
    )
    assert near.missed_ticks == 0
    ignored = config_from({"sensor.housing_weight": 0.0}).estimator.sensing
    unused = accelerometer.sense(ignored, state.sensor, AccelerometerInput(0.0, 0.0, rail_m_s2, 0))
    assert unused.missed_ticks == 0


def test_the_offset_of_a_housing_at_rest_is_known_before_a_start() -> None:
    """Within 0.3 s, for which a start waits, to 2 of its 50 mg, with noise of 10 mg."""
    config = config_from({})
    noise_m_s2 = np.random.default_rng(5).normal(0.0, 0.1, 300)
    sensor = estimator_state.INITIAL.sensor
    for one in noise_m_s2.tolist():
        sensor = accelerometer.sense(
            config.estimator.sensing, sensor, AccelerometerInput(0.0, 0.0, 0.5 + one, 0)
        )
    assert sensor.housing_offset_m_s2 == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_housing_that_is_moved_or_tilted_after_power_up_is_no_offset(sign: float) -> None:
    """A jolt of 20 m/s² for 0.1 s once shifted the estimate by 0.1 m, and the impulse's limit tripped."""
    own, sensor = config_from({}).estimator.sensing, estimator_state.INITIAL.sensor
    for k in range(300):
        jolt_m_s2 = sign * 20.0 * math.sin(math.pi * (k - 200) / 100.0) if k > 200 else 0.0
        sensor = accelerometer.sense(own, sensor, AccelerometerInput(0.0, 0.0, jolt_m_s2, 0))
    assert abs(sensor.housing_offset_m_s2) < 0.1
    for _ in range(1000):
        sensor = accelerometer.sense(own, sensor, AccelerometerInput(0.0, 0.0, sign * 0.9, 0))
    assert abs(sensor.housing_offset_m_s2) <= 0.5


def test_touch_down_and_separation_put_the_striker_at_the_stop() -> None:
    config = config_from({})
    state = rested(config, 5)
    wide = state._replace(x_m=0.170, v_m_s=0.9, p_xx=1e-4, p_vv=1e-3, p_xv=0.0)
    touch_down = Contact(True, False, 1e-3, 0.9, True, False)
    touched = tick(config, wide, 0.0, contact=touch_down, phase=ContactPhase.CONTACT)
    assert touched.x_m == pytest.approx(0.1809, abs=2e-4)
    assert touched.p_xx < 2e-7
    assert touched.touch_down.v_m_s == 0.9
    left = tick(
        config,
        touched._replace(x_m=0.1815, v_m_s=-0.45, p_xx=1e-6),
        0.0,
        contact=Contact(False, True, 1e-3, 0.9, True, False),
    )
    assert left.x_m < 0.1810
    assert left.x_m > 0.1790


def test_a_separation_from_a_soft_stop_that_returns_little_leaves_the_position_as_it_is() -> None:
    """Its force is too small to be seen before the striker is out, by up to 5.3 mm."""
    config = config_from({"stop.restitution": 0.24, "stop.contact_s": 0.025})
    inside = rested(config, 5)._replace(x_m=0.1825, v_m_s=-0.2, p_xx=1e-8, p_vv=1e-3, p_xv=0.0)
    left = tick(config, inside, 0.0, contact=Contact(False, True, 1e-3, 0.9, True, False))
    assert left.x_m == pytest.approx(0.1825 - 0.2 * 1e-3, abs=1e-4)


@pytest.mark.parametrize("true_m", [0.045, 0.179])
def test_a_touch_down_that_the_estimate_excludes_leaves_open_which_of_the_two_is_wrong(true_m: float) -> None:
    config = config_from(EXACT_SENSOR)
    state = rested(config, 5)
    sure = state._replace(x_m=0.045, v_m_s=0.6, bias_m_s2=0.0, p_xx=1e-6, p_vv=1e-4, p_xv=0.0, p_bb=1e-4)
    touch_down = Contact(True, False, 1e-3, 0.9, True, False)
    separation = Contact(False, True, 1e-3, 0.9, True, False)
    torn = tick(config, sure, -50.0, contact=touch_down, phase=ContactPhase.CONTACT)
    assert torn.p_xx > 0.05**2
    left = tick(config, torn, -50.0, contact=separation)
    x_m, v_m_s = true_m, -0.45
    for _ in range(10):
        a_m_s2 = striker_model.model_acceleration(config.nominal, 0.0, x_m, v_m_s)
        x_m, v_m_s = x_m + 1e-3 * v_m_s, v_m_s + 1e-3 * a_m_s2
        left = tick(config, left, striker_model.model_acceleration(config.nominal, 0.0, x_m, v_m_s))
    assert left.x_m == pytest.approx(x_m, abs=3e-3)


def test_newtons_law_stands_in_for_a_clipped_contact_and_its_covariance_is_the_saltation_of_the_flow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = config_from({"estimator.restitution_std": 1e-3, "estimator.stop_std_m": 1e-6})
    monkeypatch.setattr(newton, "SEPARATION_JITTER_S", 0.0)
    p = Covariance(1e-8, 2e-9, 0.0, 1e-6, 0.0, 1e-4)
    before = StateEstimate(0.18, 0.9, 0.2, p)
    nominal = config.nominal._replace(end_depth_m=0.0)
    after = newton.apply_newton(nominal, config.p.estimator, 0.25, before, 0.4, 0.0)
    assert after.x_m == pytest.approx(0.18)
    assert after.v_m_s == pytest.approx(-0.45)
    assert after.bias_m_s2 == 0.25

    def through(x: float, v: float) -> tuple[float, float]:
        """Where a neighbour that starts at t = 0 is at t = 0: it meets the stop earlier or later."""
        a0 = striker_model.model_acceleration(config.nominal, 0.4, 0.18, 0.9)
        a1 = striker_model.model_acceleration(config.nominal, 0.4, 0.18, -0.45)
        t = (0.18 - x) / v
        v_hit = v + a0 * t
        v_out = -0.5 * v_hit - a1 * t
        return 0.18 - v_out * t, v_out

    e = 1e-6
    centre = np.array(through(0.18, 0.9))
    jacobian = np.column_stack(
        [
            (np.array(through(0.18 + e, 0.9)) - centre) / e,
            (np.array(through(0.18, 0.9 + e)) - centre) / e,
        ]
    )
    expected = jacobian @ np.array([[p.xx, p.xv], [p.xv, p.vv]]) @ jacobian.T
    expected[1, 1] += 0.81e-6
    got = np.array([[after.p.xx, after.p.xv], [after.p.xv, after.p.vv]])
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=2e-12)


def test_gaps_are_bridged_by_the_model() -> None:
    config = config_from(EXACT_SENSOR)
    f = striker_model.free_flight(87.5, 0.25, 1e-3)
    x, v, state = 0.03, 0.2, estimator_state.INITIAL
    for k in range(6000):
        state = tick(config, state, -87.5 * x - 0.25 * v, age=0 if k < 5950 else 5)
        x, v = f.x_x * x + f.x_v * v, f.v_x * x + f.v_v * v
    assert state.sensor.missed_ticks == 50
    assert state.x_m - 0.12 == pytest.approx(f.x_v * 0 + x, abs=1e-3)
    assert state.p_vv > (3e-3) ** 2 * 40


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_a_missing_reading(bad: float) -> None:
    config = config_from({})
    assert not tick(config, estimator_state.INITIAL, bad).started
    hit = tick(config, rested(config, 10, 0.1), bad)
    assert hit.sensor.missed_ticks == 1
    assert math.isfinite(hit.x_m + hit.v_m_s + hit.p_xx)


def test_an_estimate_that_is_no_number_starts_anew() -> None:
    config = config_from({})
    state = tick(config, estimator_state.INITIAL, 0.0)
    anew = tick(config, state._replace(x_m=math.nan), 0.0)
    assert anew == estimator_state.INITIAL._replace(sensor=anew.sensor)
    assert anew.sensor.missed_ticks == 0  # the readings are well


def test_variances_keep_their_floors() -> None:
    state = rested(config_from({}), 3000)
    assert state.p_xx >= estimator.POSITION_FLOOR_M**2
    assert state.p_vv >= estimator.VELOCITY_FLOOR_M_S**2
    assert state.p_bb >= estimator.BIAS_FLOOR_M_S2**2


def test_a_dry_guide_widens_what_the_model_is_trusted_with() -> None:
    dry = config_from({"friction.mu": 0.2})
    wet = config_from({})
    one, other = (tick(c, tick(c, estimator_state.INITIAL, 0.0), 0.0) for c in (dry, wet))
    assert one.p_xx > other.p_xx


@pytest.mark.parametrize(
    ("v_m_s", "variance", "after"),
    [(0.03, 1e-4, 31), (0.03, 1e-2, 152), (0.12, 1e-2, 152), (0.12, 1e-4, math.inf)],
)
def test_an_unsure_velocity_is_called_none_later_and_from_further_off(
    v_m_s: float, variance: float, after: float
) -> None:
    """A striker that slides beside a slow crank is pulled by nothing either, but only for a while."""
    config = config_from({"friction.mu": 0.2})
    state = tick(config, estimator_state.INITIAL, 0.0)._replace(v_m_s=v_m_s, p_vv=variance)
    steps_m_s = []
    for _ in range(160):
        before_m_s = state.v_m_s
        state = tick(config, state, 0.0)
        steps_m_s.append(abs(state.v_m_s - before_m_s))
    found = int(np.argmax(steps_m_s)) + 1 if max(steps_m_s) > 0.01 else math.inf
    assert found == pytest.approx(after, abs=3)


def test_nothing_is_estimated_before_the_first_reading() -> None:
    config = config_from({})
    state = tick(config, estimator_state.INITIAL, 0.0, age=NEVER_TICKS)
    assert not state.started


def moving_housing(config: Config, seconds: float = 12.0) -> np.ndarray:
    """Errors of x on a housing that is shaken at 1 Hz and whose accelerometer has an offset, the last 4 s."""
    f = striker_model.free_flight(87.5, 0.25, 1e-3)
    x, v, state, errors = 0.0, 0.0, estimator_state.INITIAL, []
    for k in range(round(1000 * seconds)):
        shake = 1.5 * math.sin(2.0 * math.pi * 1e-3 * k)
        state = tick(config, state, -87.5 * x - 0.25 * v + 0.1, high=0.0, housing=shake + 0.4)
        errors.append(state.x_m - 0.12 - x)
        # The base's acceleration, held over the tick, moves the fixed point of the oscillator.
        middle = 1.5 * math.sin(2.0 * math.pi * 1e-3 * (k + 0.5))
        fixed = -middle / 87.5
        x, v = fixed + f.x_x * (x - fixed) + f.x_v * v, f.v_x * (x - fixed) + f.v_v * v
    return np.array(errors[-4000:])


def test_a_moving_housing_is_taken_off_and_its_sensors_offset_is_not() -> None:
    with_it = moving_housing(config_from(EXACT_SENSOR))
    without = moving_housing(config_from(EXACT_SENSOR | {"sensor.housing_weight": 0.0}))
    assert np.sqrt(np.mean(with_it**2)) < 1.5e-3
    assert np.sqrt(np.mean(with_it**2)) < 0.5 * np.sqrt(np.mean(without**2))


def test_a_coarse_position_corrects_whenever_one_comes() -> None:
    config = config_from({"friction.mu": 0.2})
    rng = np.random.default_rng(1)
    states = {}
    for fitted in (False, True):
        state = estimator_state.INITIAL
        for k in range(3000):
            updated = fitted and k % 20 == 0
            position_m = 0.105 + 2e-3 * rng.standard_normal()
            reading = Measurement(position_m, 0 if updated else NEVER_TICKS)
            coarse = NOTHING_MEASURED._replace(coarse_position_m=reading)
            state = tick(config, state, 0.0, measured=coarse)
        states[fitted] = state
    assert states[True].x_m == pytest.approx(0.105, abs=1e-3)
    assert states[True].p_xx < 0.001**2
    # Held by friction 15 mm off, it cannot be known without: ±μ m g/c is said, for as long as it lasts.
    assert math.sqrt(states[False].p_xx) == pytest.approx(0.2 * 9.80665 / 87.5, rel=0.1)
    assert abs(states[False].x_m - 0.105) < 3.0 * math.sqrt(states[False].p_xx)


def test_how_far_the_model_is_off_is_learnt_within_its_bounds() -> None:
    config = config_from(EXACT_SENSOR)
    p = config.p.estimator
    learnt = p.initial_model_std_m_s2**2
    for _ in range(10_000):
        learnt = estimator.learn_variance(config.estimator, learnt, 0.0, 0.0)
    assert learnt == p.model_std_m_s2**2
    for k in range(20_000):
        learnt = estimator.learn_variance(config.estimator, learnt, 0.2 if k % 2 else -0.2, 0.0)
    assert learnt == pytest.approx(0.04, rel=1e-3)
    for _ in range(20_000):
        learnt = estimator.learn_variance(config.estimator, learnt, 1e6, 0.0)
    assert learnt == p.largest_model_std_m_s2**2
    assert estimator.learn_variance(config.estimator, 0.01, math.nan, 0.0) <= p.largest_model_std_m_s2**2


def test_a_push_is_none_of_the_models_business_unless_it_lasts() -> None:
    config = config_from(EXACT_SENSOR)
    usual = zeroed(
        estimator_state.Prediction,
        sensor=estimator_state.INITIAL.sensor._replace(missed_ticks=0),
        innovation_std_m_s2=0.1,
        model_variance=0.01,
        started=True,
        carried=True,
    )
    pushed = usual._replace(innovation_m_s2=-50.0)
    assert estimator.count_gated_ticks(config.estimator, 7, usual) == 0
    assert estimator.count_gated_ticks(config.estimator, 7, pushed) == 8
    assert estimator.count_gated_ticks(config.estimator, NEVER_TICKS, pushed) == NEVER_TICKS
    missing = usual._replace(sensor=usual.sensor._replace(missed_ticks=1))  # without a reading no innovation
    assert estimator.count_gated_ticks(config.estimator, 7, missing) == 8
    assert estimator.count_gated_ticks(config.estimator, 0, missing) == 0
    assert estimator.count_gated_ticks(config.estimator, NEVER_TICKS, missing) == NEVER_TICKS


@pytest.mark.parametrize("tick_s", [0.00025, 0.0005, 0.004])
def test_noise_is_one_of_time_not_of_ticks(tick_s: float) -> None:
    """At another control period the same variance accumulates in a second."""
    usual, other = (config_from({"control.tick_s": one}).estimator for one in (0.001, tick_s))
    for name in ("flight_noise", "contact_noise", "gap_noise"):
        one, another = getattr(usual, name), getattr(other, name)
        assert another.vv / tick_s == pytest.approx(one.vv / 0.001)
        assert another.bb / tick_s == pytest.approx(one.bb / 0.001)
    assert usual.flight_noise.vv == 3e-05 * 3e-05
