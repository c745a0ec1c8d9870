"""The nominal striker in free flight: m x'' + c (x − l0 − A sin θ) + b x' + μ m g sign x' = 0."""

import math
from typing import NamedTuple

from firmware_py.core.elementary import sin
from firmware_py.core.estimation.kalman import Transition

PULL_FACTOR = 1.5
"""A reading beyond this many times the nominal spring's largest acceleration is due to the stop."""


class NominalStriker(NamedTuple):
    """The firmware's nominal striker, forces per unit of mass; the plant's true values may differ."""

    stiffness_1_s2: float
    damping_1_s: float
    dry_m_s2: float
    rest_length_m: float
    amplitude_m: float
    stop_m: float
    restitution: float


def model_acceleration(config: NominalStriker, angle_rad: float, x_m: float, v_m_s: float) -> float:
    """x'' in free flight, m/s²."""
    friction = config.damping_1_s * v_m_s
    if v_m_s > 0.0:
        friction += config.dry_m_s2
    elif v_m_s < 0.0:
        friction -= config.dry_m_s2
    pull = config.stiffness_1_s2 * (x_m - config.rest_length_m - config.amplitude_m * sin(angle_rad))
    return -pull - friction


def is_of_the_stop(striker: NominalStriker, reading_m_s2: float) -> bool:
    """Whether only the stop can cause this reading: it exceeds the spring's pull anywhere in the travel."""
    travel_m = striker.stop_m - striker.rest_length_m + striker.amplitude_m
    return reading_m_s2 < -PULL_FACTOR * (striker.stiffness_1_s2 * travel_m + striker.dry_m_s2)


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
