"""The nominal striker in free flight: m x'' + c (x − l0 − A sin θ) + b x' + μ m g sign x' = 0."""

import math

from firmware_py.core.config import Config, Transition
from firmware_py.core.elementary import sin


def model_acceleration(config: Config, angle_rad: float, x_m: float, v_m_s: float) -> float:
    """x'' in free flight, m/s²."""
    p, d = config.p, config.d
    friction = d.damping_1_s * v_m_s
    if v_m_s > 0.0:
        friction += d.dry_m_s2
    elif v_m_s < 0.0:
        friction -= d.dry_m_s2
    pull = d.stiffness_1_s2 * (x_m - p.striker.rest_length_m - p.drive.amplitude_m * sin(angle_rad))
    return -pull - friction


def free_flight(stiffness_1_s2: float, damping_1_s: float, dt_s: float) -> Transition:
    """exp(F dt) of x'' = −(c/m) x − (b/m) x', in closed form for under-, critical and overdamping."""
    sigma = 0.5 * damping_1_s
    square = stiffness_1_s2 - sigma * sigma
    decay = math.exp(-sigma * dt_s)
    cosine, sine_over_omega = 1.0, dt_s
    if square > 0.0:
        omega = math.sqrt(square)
        cosine, sine_over_omega = math.cos(omega * dt_s), math.sin(omega * dt_s) / omega
    elif square < 0.0:
        omega = math.sqrt(-square)
        cosine, sine_over_omega = math.cosh(omega * dt_s), math.sinh(omega * dt_s) / omega
    return Transition(
        x_x=decay * (cosine + sigma * sine_over_omega),
        x_v=decay * sine_over_omega,
        x_b=0.0,
        v_x=-decay * stiffness_1_s2 * sine_over_omega,
        v_v=decay * (cosine - sigma * sine_over_omega),
        v_b=0.0,
    )


def strapdown(dt_s: float) -> Transition:
    """F of a tick that integrates the accelerometer; the bias is subtracted from the reading."""
    return Transition(1.0, dt_s, -0.5 * dt_s * dt_s, 0.0, 1.0, -dt_s)
