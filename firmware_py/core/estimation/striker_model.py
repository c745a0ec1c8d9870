"""The nominal striker in free flight: m x'' + c (x − l0 − A sin θ) + b x' + μ m g sign x' = 0.

`Nominal` also describes its stop and its sensors. Its parameters never change over the bus, so a commit keeps
every bit of it.
"""

import math
from typing import NamedTuple

from firmware_py.core.elementary import sin, sine_cosine
from firmware_py.core.estimation import stop_model
from firmware_py.core.estimation.kalman import Row, StateEstimate, Transition
from firmware_py.core.numbers import TAU, in_ticks
from firmware_py.interface.generated.parameters import Drive, Parameters, Stop, Striker

STANDARD_GRAVITY_M_S2 = 9.80665


class Nominal(NamedTuple):
    """Parameters, and constants derived from them. Forces are per unit of the striker's mass.

    `sensor_delay_s`: the accelerometers' low-pass. `flight`: F of a tick of the model, `strapdown`: of a tick
    that integrates the accelerometer; `row`: H of the model. `contact_growth`: factor of the Hertz contact,
    a = growth · (x'⁻ t)^1.5, m/s² per m^1.5. `contact_ticks`: the nominal duration of a contact;
    `end_depth_m`: the largest depth at which the detector finds its end.
    """

    striker: Striker
    drive: Drive
    stop: Stop
    natural_rad_s: float
    stiffness_1_s2: float
    damping_1_s: float
    dry_m_s2: float
    sensor_delay_s: float
    flight: Transition
    strapdown: Transition
    row: Row
    contact_growth: float
    contact_ticks: int
    end_depth_m: float


def model_acceleration(nominal: Nominal, angle_rad: float, x_m: float, v_m_s: float) -> float:
    """x'' in free flight, m/s²."""
    friction = nominal.damping_1_s * v_m_s
    if v_m_s > 0.0:
        friction += nominal.dry_m_s2
    elif v_m_s < 0.0:
        friction -= nominal.dry_m_s2
    stretch_m = x_m - nominal.striker.rest_length_m - nominal.drive.amplitude_m * sin(angle_rad)
    return -(nominal.stiffness_1_s2 * stretch_m) - friction


def known_part(nominal: Nominal, estimate: StateEstimate, angle_rad: float, omega_rad_s: float) -> float:
    """The part of the model's delayed acceleration that does not depend linearly on the state, m/s².

    a_d = a − τ a' with a' = −(c/m) (x' − x_A') − (b/m) a
    """
    delay_s, amplitude_m = nominal.sensor_delay_s, nominal.drive.amplitude_m
    sine, cosine = sine_cosine(angle_rad)
    crank_m = amplitude_m * sine
    crank_m_s = amplitude_m * cosine * omega_rad_s
    rest_m = nominal.striker.rest_length_m + crank_m
    known = nominal.stiffness_1_s2 * ((1.0 + delay_s * nominal.damping_1_s) * rest_m - delay_s * crank_m_s)
    if estimate.v_m_s > 0.0:
        known -= nominal.dry_m_s2
    elif estimate.v_m_s < 0.0:
        known += nominal.dry_m_s2
    return known


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


def derive(p: Parameters) -> Nominal:
    """The nominal module of these parameters."""
    tick_s, mass_kg = p.control.tick_s, p.striker.mass_kg
    stiffness_1_s2 = p.striker.spring_n_m / mass_kg
    damping_1_s = p.friction.b_n_s_m / mass_kg
    delay_s = math.sqrt(2.0) / (TAU * p.sensor.bandwidth_hz)  # Butterworth, second order, at rest
    return Nominal(
        striker=p.striker,
        drive=p.drive,
        stop=p.stop,
        natural_rad_s=math.sqrt(stiffness_1_s2),
        stiffness_1_s2=stiffness_1_s2,
        damping_1_s=damping_1_s,
        dry_m_s2=p.friction.mu * STANDARD_GRAVITY_M_S2,
        sensor_delay_s=delay_s,
        flight=free_flight(stiffness_1_s2, damping_1_s, tick_s),
        strapdown=strapdown(tick_s),
        # a_d = a − τ a',  a = −(c/m) (x − …) − (b/m) x',  a' = −(c/m) (x' − x_A') − (b/m) a
        row=Row(
            x=-stiffness_1_s2 * (1.0 + delay_s * damping_1_s),
            v=-damping_1_s * (1.0 + delay_s * damping_1_s) + delay_s * stiffness_1_s2,
            b=1.0,
        ),
        contact_growth=stop_model.contact_growth(mass_kg, p.stop.contact_s, p.stop.restitution),
        contact_ticks=in_ticks(p.stop.contact_s, tick_s, 1),
        end_depth_m=stop_model.depth_at_end_m(p.stop.contact_s, p.stop.restitution, stop_model.END_FRACTION),
    )
