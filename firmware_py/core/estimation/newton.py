"""Newton's law of impact, x'⁺ = −k x'⁻, applied to the mean and covariance of an estimate."""

from firmware_py.core.estimation import kalman
from firmware_py.core.estimation.estimator_state import EstimatorConfig
from firmware_py.core.estimation.kalman import ProcessNoise, Push, StateEstimate, Transition
from firmware_py.core.estimation.striker_model import model_acceleration
from firmware_py.core.numbers import at_least


def thrown_back(config: EstimatorConfig, estimate: StateEstimate) -> StateEstimate:
    """The estimate after an impact without readings; its time is known to the contact's duration only."""
    k = config.striker.restitution
    jitter_m = (1.0 + k) * estimate.v_m_s * config.separation_jitter_s
    return kalman.predict_written_out(
        estimate,
        Transition(-k, 0.0, 0.0, 0.0, -k, 0.0),
        Push(x_m=(1.0 + k) * config.striker.stop_m, v_m_s=0.0),
        ProcessNoise(
            xx=config.stop_variance + jitter_m * jitter_m,
            vv=estimate.v_m_s * estimate.v_m_s * config.restitution_variance,
            bb=0.0,
        ),
    )


def newton(
    config: EstimatorConfig, bias_m_s2: float, touch_down: StateEstimate, angle_rad: float, age_s: float
) -> StateEstimate:
    """The estimate `age_s` after the separation of a detected impact, by x'⁺ = −k x'⁻.

    Ξ = [[−k, 0], [(a⁺ + k a⁻)/x'⁻, −k]]   (saltation matrix at x = x_stop)
    """
    striker = config.striker
    k = striker.restitution
    before_m_s = at_least(touch_down.v_m_s, 0.05)
    after_m_s = -k * before_m_s
    a_before = model_acceleration(striker, angle_rad, striker.stop_m, before_m_s)
    a_after = model_acceleration(striker, angle_rad, striker.stop_m, after_m_s)
    slope = (a_after + k * a_before) / before_m_s
    spread = before_m_s * before_m_s * config.restitution_variance
    jitter_m = after_m_s * config.separation_jitter_s
    jumped = kalman.predict(
        touch_down,
        Transition(-k, 0.0, 0.0, slope, -k, 0.0),
        Push(x_m=(1.0 + k) * striker.stop_m, v_m_s=-slope * striker.stop_m),
        ProcessNoise(xx=config.stop_variance + jitter_m * jitter_m, vv=spread, bb=0.0),
    )
    return StateEstimate(
        x_m=striker.stop_m + after_m_s * age_s,
        v_m_s=after_m_s + a_after * age_s,
        bias_m_s2=bias_m_s2,
        p=jumped.p,
    )
