import itertools
import math

import numpy as np
import pytest

from firmware_py.core.control import speed
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.interface.enums import ActingLimit
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
CRANK = crank.INITIAL._replace(angle_rad=0.0, omega_rad_s=12.0, missed_ticks=0)
ESTIMATE = estimator_state.striker_of(estimator_state.INITIAL)._replace(x_m=0.12)


def step(
    state: speed.SpeedState = speed.INITIAL, target: float = 12.0, omega: float = 12.0
) -> speed.SpeedState:
    return speed.step(CONFIG.p, state, CRANK._replace(omega_rad_s=omega), ESTIMATE, target, 0.0)


@pytest.mark.parametrize("x_m", [-6.0, 5.0, math.nan, math.inf])
def test_nothing_is_fed_forward_from_an_estimate_that_is_lost(x_m: float) -> None:
    lost = ESTIMATE._replace(x_m=x_m)
    assert speed.crank_load(CONFIG.p, CRANK, lost, 0.0) == 0.0
    near = ESTIMATE._replace(x_m=0.12 - 0.99 * CONFIG.p.limit.stretch_m)
    assert speed.crank_load(CONFIG.p, CRANK, near, 0.0) > 0.2


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_within_its_limits_the_torque_is_that_of_the_law(side: float) -> None:
    """T = J α* + B ω* + T_dry sign ω* + share · c (A sin θ + l0 − x) A cos θ + K_p e + K_i ∫e dt."""
    p, ahead_s = CONFIG.p, 1.5e-3
    dice = np.random.default_rng(5)
    for _ in range(20):
        angle_rad, target_rad_s = dice.uniform(0.0, 6.2), side * dice.uniform(8.0, 15.0)
        error_rad_s, integral_n_m = dice.uniform(-0.5, 0.5), dice.uniform(-0.1, 0.1)
        acceleration_rad_s2 = dice.uniform(-40.0, 40.0)
        x_m, v_m_s, omega_rad_s = dice.uniform(0.1, 0.17), dice.uniform(-0.5, 0.5), target_rad_s - error_rad_s
        theta_rad = angle_rad + omega_rad_s * ahead_s
        stretch_m = 0.02 * math.sin(theta_rad) + 0.12 - (x_m + v_m_s * ahead_s)
        load_n_m = p.speed.load_share * 70.0 * stretch_m * 0.02 * math.cos(theta_rad)
        motor_n_m = p.motor.inertia_kg_m2 * acceleration_rad_s2 + p.motor.viscous_n_m_s * target_rad_s
        fed_forward_n_m = motor_n_m + side * p.motor.dry_n_m + load_n_m
        torque_n_m = fed_forward_n_m + p.speed.gain_p_n_m_s * error_rad_s + integral_n_m
        before = speed.INITIAL._replace(integral_n_m=integral_n_m, torque_n_m=torque_n_m)
        after = speed.step(
            CONFIG.p,
            before,
            CRANK._replace(angle_rad=angle_rad, omega_rad_s=omega_rad_s),
            ESTIMATE._replace(x_m=x_m, v_m_s=v_m_s),
            target_rad_s,
            acceleration_rad_s2,
        )
        integral_n_m += p.speed.gain_i_n_m * error_rad_s * CONFIG.tick_s
        wanted = (integral_n_m, error_rad_s, fed_forward_n_m, torque_n_m, torque_n_m, ActingLimit.NONE)
        assert after == pytest.approx(wanted, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_under_a_limit_the_integral_goes_back_and_no_further_on(side: float) -> None:
    before = speed.INITIAL._replace(integral_n_m=0.58 * side, torque_n_m=0.6 * side)
    on = step(before, target=12.0 * side, omega=11.0 * side)
    back = step(before._replace(integral_n_m=2.0 * side), target=12.0 * side, omega=12.1 * side)
    braking = step(before._replace(torque_n_m=0.0), target=12.0 * side, omega=12.1 * side)
    assert braking.acting_limit == ActingLimit.TORQUE_RATE
    assert abs(braking.integral_n_m) < abs(before.integral_n_m), "it went down, away from the limit"
    falling = step(before._replace(integral_n_m=0.1 * side), target=12.0 * side, omega=11.9 * side)
    assert falling.acting_limit == ActingLimit.TORQUE_RATE
    assert abs(falling.integral_n_m) > 0.1, "the torque is above what is wanted"
    assert on.acting_limit == back.acting_limit == ActingLimit.TORQUE
    assert on.integral_n_m == before.integral_n_m
    assert abs(back.integral_n_m) == CONFIG.p.speed.torque_limit_n_m, "an integral has the torque's limit"


def test_torque_never_leaves_its_limits_and_is_always_a_number() -> None:
    bad = (math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, 15.0)
    for target, omega, x in itertools.product(bad, (0.0, 15.0, 1e3, -1e3, math.nan), bad):
        state = speed.INITIAL
        for _ in range(3):
            state = speed.step(
                CONFIG.p,
                state,
                CRANK._replace(omega_rad_s=omega),
                ESTIMATE._replace(x_m=x),
                target,
                target,
            )
            assert abs(state.torque_n_m) <= CONFIG.p.speed.torque_limit_n_m
            assert math.isfinite(state.integral_n_m)


def test_the_rate_is_limited_and_said_so() -> None:
    state = step(target=19.0, omega=0.0)
    assert state.torque_n_m == pytest.approx(CONFIG.p.speed.torque_rate_n_m_s * 1e-3)
    assert state.acting_limit == ActingLimit.TORQUE_RATE
    for _ in range(30):
        state = step(state, target=19.0, omega=0.0)
    assert state.torque_n_m == CONFIG.p.speed.torque_limit_n_m
    assert state.acting_limit == ActingLimit.TORQUE


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_speed_limit_cuts_the_torque_at_once(side: float) -> None:
    """A torque that the rate limit lowered by 0.06 N m a tick would push the crank on for ten ticks."""
    pushing = speed.INITIAL._replace(torque_n_m=0.6 * side, acting_n_m=0.6 * side)
    state = step(pushing, target=25.0 * side, omega=20.5 * side)
    assert (state.torque_n_m, state.acting_limit) == (0.0, ActingLimit.SPEED)
    braking = step(pushing._replace(torque_n_m=-0.3 * side), target=10.0 * side, omega=20.5 * side)
    assert braking.torque_n_m * side < -0.3, "a torque that brakes is not cut"
    state = step(pushing, target=25.0 * side, omega=20.0 * side)  # at the limit only the rate acts
    assert state.torque_n_m == pytest.approx(0.54 * side)
    assert state.acting_limit == ActingLimit.TORQUE_RATE


def test_nan_cuts_the_torque_at_once() -> None:
    pushing = speed.INITIAL._replace(torque_n_m=0.6, acting_n_m=0.6)
    for target, omega in ((math.nan, 12.0), (12.0, math.nan)):
        assert step(pushing, target=target, omega=omega).torque_n_m == 0.0


def test_safe_is_zero_at_once() -> None:
    state = step(target=19.0, omega=0.0)
    safe = speed.rest(state)
    assert safe.torque_n_m == 0.0
    assert safe.integral_n_m == 0.0
    assert safe.acting_n_m == state.torque_n_m
    assert safe.acting_limit == ActingLimit.SAFE_STATE
