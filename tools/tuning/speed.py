"""Design of the crank's speed loop with python-control: gains, and the margins that they leave.

The loop as it runs, sampled at the control period T:

- the motor, J θ'' + B θ' = T_motor, with the torque held for one period;
- the way of a torque over the bus: computed from the sensors' state at t_k, it acts from t_{k+1};
- the firmware's tracker (θ, θ', disturbance), which knows the torque that acts and corrects by the encoder;
- PI on the tracker's speed.

Cut where the torque reaches the motor, this gives the loop's phase and gain margins; closed, its bandwidth.
The crank's load and dry friction are fed forward and act as disturbances. Proportional gain: K_p = J ω_c puts
the crossover near ω_c; the integral's corner lies `integral_ratio` below it.
"""

import math
from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import NDArray

from firmware_py.shell.parameters import DEFAULTS, critically_damped_gains

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SpeedDesign:
    """Gains, rounded to two digits, and what the loop does with them.

    `bandwidth_rad_s`: where the closed loop, from target to speed, has fallen by 3 dB. `peak`: the largest
    sensitivity |1/(1 + L)|. `load_stiffness_n_m_s`: the smallest |load torque / speed| at any frequency.
    """

    gain_p_n_m_s: float
    gain_i_n_m: float
    crossover_rad_s: float
    bandwidth_rad_s: float
    phase_margin_deg: float
    gain_margin_db: float
    peak: float
    load_stiffness_n_m_s: float


def design_speed_loop(
    inertia_kg_m2: float = DEFAULTS["motor.inertia_kg_m2"],
    viscous_n_m_s: float = DEFAULTS["motor.viscous_n_m_s"],
    tick_s: float = DEFAULTS["control.tick_s"],
    tracker_rad_s: float = DEFAULTS["crank.bandwidth_rad_s"],
    crossover_rad_s: float = 100.0,
    integral_ratio: float = 6.25,
) -> SpeedDesign:
    """Gains for a crossover near `crossover_rad_s`, and the margins of the loop as it runs."""
    gain_p = _rounded(inertia_kg_m2 * crossover_rad_s)
    gain_i = _rounded(inertia_kg_m2 * crossover_rad_s**2 / integral_ratio)
    loop = speed_loop(inertia_kg_m2, viscous_n_m_s, tick_s, tracker_rad_s, gain_p, gain_i)
    # From a hundredth of the crossover up: the double integrator below has no margins, only rounding errors.
    omega = np.geomspace(0.01 * crossover_rad_s, 0.99 * math.pi / tick_s, 4000)
    response = _response(loop, omega)
    gain_margin, phase_margin, _, _, crossover, _ = control.stability_margins(control.frd(response, omega))

    motor = _response(_motor(inertia_kg_m2, viscous_n_m_s, tick_s), omega)
    # The tracker follows the motor exactly while it knows the torque: the target sees K G / (1 + K G).
    pi = gain_p + gain_i * tick_s / (1.0 - np.exp(-1j * omega * tick_s))
    forward = pi * motor * np.exp(-1j * omega * tick_s)
    closed = np.abs(forward / (1.0 + forward))
    fallen = np.flatnonzero(closed < math.sqrt(0.5))
    sensitivity = 1.0 / (1.0 + response)
    return SpeedDesign(
        gain_p_n_m_s=gain_p,
        gain_i_n_m=gain_i,
        crossover_rad_s=float(crossover),
        bandwidth_rad_s=float(omega[fallen[0]]),
        phase_margin_deg=float(phase_margin),
        gain_margin_db=20.0 * math.log10(float(gain_margin)),
        peak=float(np.max(np.abs(sensitivity))),
        load_stiffness_n_m_s=float(np.min(1.0 / np.abs(sensitivity * motor))),
    )


def speed_loop(
    inertia_kg_m2: float,
    viscous_n_m_s: float,
    tick_s: float,
    tracker_rad_s: float,
    gain_p_n_m_s: float,
    gain_i_n_m: float,
) -> control.StateSpace:
    """L(z) = −(torque commanded) / (torque acting), cut where the torque reaches the motor.

    State: motor (θ, ω), tracker (θ̂, ω̂, d̂) after its correction, integral, torque under way.
    """
    T, J = tick_s, inertia_kg_m2
    g, h, k = critically_damped_gains(tracker_rad_s, T)
    motor = _motor_matrices(J, viscous_n_m_s, T)
    # One tick: the torque u acts from t_k to t_{k+1}; the sensors are read at t_{k+1}.
    a = np.zeros((7, 7))
    b = np.zeros((7, 1))
    a[0:2, 0:2], b[0:2] = motor
    # The tracker predicts with the torque that it commanded, which is under way in state 6.
    predicted = np.zeros((3, 7))
    predicted[0, 2:5] = (1.0, T - 0.5 * T * T * viscous_n_m_s / J, 0.5 * T * T)
    predicted[1, 2:5] = (0.0, 1.0 - T * viscous_n_m_s / J, T)
    predicted[2, 2:5] = (0.0, 0.0, 1.0)
    predicted[0, 6], predicted[1, 6] = 0.5 * T * T / J, T / J
    error_a, error_b = a[0] - predicted[0], b[0, 0]
    gains = np.array([g, h / T, 2.0 * k / (T * T)])
    a[2:5] = predicted + np.outer(gains, error_a)
    b[2:5, 0] = gains * error_b
    # PI on the tracker's speed against a target of 0.
    a[5] = -gain_i_n_m * T * a[3]
    a[5, 5] += 1.0
    b[5] = -gain_i_n_m * T * b[3]
    # K_p e + the integral as it was; e = −ω̂ of this tick.
    a[6] = -gain_p_n_m_s * a[3]
    a[6, 5] += 1.0
    b[6] = -gain_p_n_m_s * b[3]
    # What was under way at t_k acts from t_k; it is state 6 before this tick.
    c = np.zeros((1, 7))
    c[0, 6] = -1.0
    return control.ss(a, b, c, np.zeros((1, 1)), T)


def _motor_matrices(
    inertia_kg_m2: float, viscous_n_m_s: float, tick_s: float
) -> tuple[FloatArray, FloatArray]:
    """Angle and speed of J θ'' + B θ' = T_motor over a tick of held torque, exactly."""
    continuous = control.ss(
        [[0.0, 1.0], [0.0, -viscous_n_m_s / inertia_kg_m2]],
        [[0.0], [1.0 / inertia_kg_m2]],
        np.eye(2),
        np.zeros((2, 1)),
    )
    sampled = control.sample_system(continuous, tick_s, method="zoh")
    return np.asarray(sampled.A), np.asarray(sampled.B)


def _motor(inertia_kg_m2: float, viscous_n_m_s: float, tick_s: float) -> control.StateSpace:
    """From torque to speed, sampled."""
    a, b = _motor_matrices(inertia_kg_m2, viscous_n_m_s, tick_s)
    return control.ss(a, b, [[0.0, 1.0]], [[0.0]], tick_s)


def _response(system: control.StateSpace, omega_rad_s: FloatArray) -> NDArray[np.complex128]:
    z = np.exp(1j * omega_rad_s * system.dt)
    return np.asarray(system(z), np.complex128).reshape(-1)


def _rounded(value: float) -> float:
    """Two significant digits: a gain is not worth more."""
    return float(f"{value:.2g}")
