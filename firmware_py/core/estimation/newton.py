"""Newton's law of impact, x'⁺ = −k x'⁻, applied to the mean and covariance of an estimate."""

from firmware_py.core.estimation import kalman
from firmware_py.core.estimation.kalman import ProcessNoise, Push, StateEstimate, Transition
from firmware_py.core.estimation.striker_model import Nominal, model_acceleration
from firmware_py.core.numbers import at_least
from firmware_py.interface.generated.parameters import Estimator

SEPARATION_JITTER_S = 0.0005
"""Standard deviation of the instant of a detected separation."""


def stop_variance(estimator: Estimator) -> float:
    """The variance of the stop's position, m²."""
    return estimator.stop_std_m * estimator.stop_std_m


def restitution_variance(estimator: Estimator) -> float:
    """The variance of the restitution."""
    return estimator.restitution_std * estimator.restitution_std


def separation_variance(nominal: Nominal, v_m_s: float) -> float:
    """The variance of the position at a detected separation, without that of the stop, m².

    The striker is anywhere between the depth at which the detector may find the end, and the surface.
    """
    jitter_m = v_m_s * SEPARATION_JITTER_S
    return jitter_m * jitter_m + nominal.end_depth_m * nominal.end_depth_m / 3.0


def apply_newton(
    nominal: Nominal,
    estimator: Estimator,
    bias_m_s2: float,
    touch_down: StateEstimate,
    angle_rad: float,
    age_s: float,
) -> StateEstimate:
    """The estimate `age_s` after the separation of a detected impact, by x'⁺ = −k x'⁻.

    Ξ = [[−k, 0], [(a⁺ + k a⁻)/x'⁻, −k]]   (saltation matrix at x = x_stop)
    """
    k, stop_m = nominal.stop.restitution, nominal.stop.position_m
    before_m_s = at_least(touch_down.v_m_s, 0.05)
    after_m_s = -k * before_m_s
    a_before = model_acceleration(nominal, angle_rad, stop_m, before_m_s)
    a_after = model_acceleration(nominal, angle_rad, stop_m, after_m_s)
    slope = (a_after + k * a_before) / before_m_s
    spread = before_m_s * before_m_s * restitution_variance(estimator)
    jumped = kalman.predict(
        touch_down,
        Transition(-k, 0.0, 0.0, slope, -k, 0.0),
        Push(x_m=(1.0 + k) * stop_m, v_m_s=-slope * stop_m),
        ProcessNoise(
            xx=stop_variance(estimator) + separation_variance(nominal, after_m_s), vv=spread, bb=0.0
        ),
    )
    return StateEstimate(
        x_m=stop_m + after_m_s * age_s, v_m_s=after_m_s + a_after * age_s, bias_m_s2=bias_m_s2, p=jumped.p
    )
