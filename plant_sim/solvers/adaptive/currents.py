"""What windings add to the integrated state, and the torque that turns the crank.

Windings in the rotor's frame have i_d, i_q and the two integrals of the current loop at `place` of the state;
at `account` the work at their terminals and what of it heats the copper.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import by_part, law, subroutine
from plant_sim.parts.drive import Drive, MotorDrive, motor_current_a, motor_torque_n_m
from plant_sim.parts.winding import (
    DqWinding,
    Settled,
    Winding,
    asked_current_a,
    flux_wb,
    mean_flux_wb,
    voltage_limit_v,
)

Vector = NDArray[np.float64]


STABLE = 4.5
"""h |λ| at which DOP853 damps a real pole well; its stability ends at about 6."""


class Voltages(NamedTuple):
    """In the rotor's frame, V."""

    d: float
    q: float


@by_part
def winding_size(winding: Winding) -> int:
    """How many quantities of motion the windings add."""
    return 0


@law(winding_size, DqWinding)
def _(winding: DqWinding) -> int:
    return 4


@by_part
def winding_integrals(winding: Winding) -> int:
    """How many of the ledger's integrals the windings have."""
    return 0


@law(winding_integrals, DqWinding)
def _(winding: DqWinding) -> int:
    return 2


@by_part
def turning_current_a(
    winding: Winding, drive: Drive, torque_n_m: float, omega_rad_s: float, y: Vector, place: int
) -> float:
    """The current, A, that makes torque: i_q."""
    raise NotImplementedError


@law(turning_current_a, Settled)
def _(winding: Settled, drive: Drive, torque_n_m: float, omega_rad_s: float, y: Vector, place: int) -> float:
    return motor_current_a(drive, torque_n_m, omega_rad_s)


@law(turning_current_a, DqWinding)
def _(
    winding: DqWinding, drive: Drive, torque_n_m: float, omega_rad_s: float, y: Vector, place: int
) -> float:
    current_a: float = y[place + 1]
    return current_a


@by_part
def turning_torque_n_m(
    winding: Winding,
    drive: Drive,
    torque_n_m: float,
    angle_rad: float,
    omega_rad_s: float,
    y: Vector,
    place: int,
) -> float:
    """The torque of the motor's current on the crank, N m, where `torque_n_m` is asked for."""
    raise NotImplementedError


@law(turning_torque_n_m, Settled)
def _(
    winding: Settled,
    drive: Drive,
    torque_n_m: float,
    angle_rad: float,
    omega_rad_s: float,
    y: Vector,
    place: int,
) -> float:
    return motor_torque_n_m(drive, torque_n_m, omega_rad_s)


@law(turning_torque_n_m, DqWinding)
def _(
    winding: DqWinding,
    drive: MotorDrive,
    torque_n_m: float,
    angle_rad: float,
    omega_rad_s: float,
    y: Vector,
    place: int,
) -> float:
    i_d, i_q = y[place], y[place + 1]
    saliency_h = winding.d_inductance_h - winding.q_inductance_h
    # T = 3/2 p (ψ i_q + (L_d − L_q) i_d i_q)
    torque: float = 1.5 * drive.pole_pairs * (flux_wb(winding, drive, angle_rad) + saliency_h * i_d) * i_q
    return torque


@subroutine
def asked_voltages(
    winding: DqWinding, drive: MotorDrive, torque_n_m: float, omega_rad_s: float, y: Vector, place: int
) -> Voltages:
    """What the current loop asks of the inverter, V."""
    i_d, i_q, u_d, u_q = y[place], y[place + 1], y[place + 2], y[place + 3]
    electrical = drive.pole_pairs * omega_rad_s
    L_d, L_q, alpha = winding.d_inductance_h, winding.q_inductance_h, winding.bandwidth_rad_s
    return Voltages(
        u_d - alpha * L_d * i_d - electrical * L_q * i_q,
        u_q
        + alpha * L_q * (asked_current_a(drive, torque_n_m) - i_q)
        + electrical * (L_d * i_d + mean_flux_wb(drive)),
    )


@subroutine
def voltage_excess(
    winding: DqWinding, drive: MotorDrive, torque_n_m: float, omega_rad_s: float, y: Vector, place: int
) -> float:
    """|v*|² − V²/3, V²: above 0 where the bus limits the current loop."""
    asked = asked_voltages(winding, drive, torque_n_m, omega_rad_s, y, place)
    limit = voltage_limit_v(drive)
    return asked.d * asked.d + asked.q * asked.q - limit * limit


@by_part
def winding_derivative(
    winding: Winding,
    drive: Drive,
    torque_n_m: float,
    limited: bool,
    angle_rad: float,
    omega_rad_s: float,
    y: Vector,
    place: int,
    account: int,
    out: Vector,
) -> None:
    """Fill in the windings' part of the derivative."""
    return


@law(winding_derivative, DqWinding)
def _(
    winding: DqWinding,
    drive: MotorDrive,
    torque_n_m: float,
    limited: bool,
    angle_rad: float,
    omega_rad_s: float,
    y: Vector,
    place: int,
    account: int,
    out: Vector,
) -> None:
    i_d, i_q = y[place], y[place + 1]
    L_d, L_q, R = winding.d_inductance_h, winding.q_inductance_h, drive.resistance_ohm
    asked = asked_voltages(winding, drive, torque_n_m, omega_rad_s, y, place)
    share = 1.0
    if limited:
        share = voltage_limit_v(drive) / math.sqrt(asked.d * asked.d + asked.q * asked.q)
    v_d, v_q = share * asked.d, share * asked.q
    electrical = drive.pole_pairs * omega_rad_s
    out[place] = (v_d - R * i_d + electrical * L_q * i_q) / L_d
    out[place + 1] = (v_q - R * i_q - electrical * (L_d * i_d + flux_wb(winding, drive, angle_rad))) / L_q
    # u' = α R (i* − i) + (R/L)(v − v*): nothing is added up that the bus cannot give
    alpha_R = winding.bandwidth_rad_s * R
    out[place + 2] = -alpha_R * i_d + R / L_d * (v_d - asked.d)
    out[place + 3] = alpha_R * (asked_current_a(drive, torque_n_m) - i_q) + R / L_q * (v_q - asked.q)
    out[account] = 1.5 * (v_d * i_d + v_q * i_q)
    out[account + 1] = 1.5 * R * (i_d * i_d + i_q * i_q)


@subroutine
def voltage_may_end(
    winding: DqWinding,
    drive: MotorDrive,
    torque_n_m: float,
    h_s: float,
    y: Vector,
    new: Vector,
    k: Vector,
    speed: int,
    place: int,
) -> bool:
    """Whether the loop could ask for more than the bus has within a step: bounds as of other events.

    `speed` is the crank speed's place in the state. Of slopes within ± S, |g| is at most
    (|g0| + |g1| + S h) / 2.
    """
    steep_d, steep_q, steep_u_d, steep_u_q, steep_speed = 0.0, 0.0, 0.0, 0.0, 0.0
    for stage in range(12):
        steep_d = max(steep_d, abs(k[stage, place]))
        steep_q = max(steep_q, abs(k[stage, place + 1]))
        steep_u_d = max(steep_u_d, abs(k[stage, place + 2]))
        steep_u_q = max(steep_u_q, abs(k[stage, place + 3]))
        steep_speed = max(steep_speed, abs(k[stage, speed]))
    L_d, L_q, alpha = winding.d_inductance_h, winding.q_inductance_h, winding.bandwidth_rad_s
    h = 2.0 * h_s
    fastest = drive.pole_pairs * (max(abs(y[speed]), abs(new[speed])) + h * steep_speed)
    most_d = max(abs(y[place]), abs(new[place])) + h * steep_d
    most_q = max(abs(y[place + 1]), abs(new[place + 1])) + h * steep_q
    faster = drive.pole_pairs * steep_speed
    change_d = steep_u_d + alpha * L_d * steep_d + L_q * (faster * most_q + fastest * steep_q)
    change_q = (
        steep_u_q
        + alpha * L_q * steep_q
        + L_d * (faster * most_d + fastest * steep_d)
        + faster * mean_flux_wb(drive)
    )
    before = asked_voltages(winding, drive, torque_n_m, y[speed], y, place)
    after = asked_voltages(winding, drive, torque_n_m, new[speed], new, place)
    d = 0.5 * (abs(before.d) + abs(after.d) + h * change_d)
    q = 0.5 * (abs(before.q) + abs(after.q) + h * change_q)
    limit = voltage_limit_v(drive)
    reached: bool = d * d + q * q >= limit * limit
    return reached


@by_part
def current_s(winding: Winding, drive: Drive) -> float:
    """How long a step may be for the windings' sake, s: the method is stable to h λ = −6 or so."""
    return math.inf


@law(current_s, DqWinding)
def _(winding: DqWinding, drive: MotorDrive) -> float:
    """The loop's poles are −α and, where the integral cancels them, −R/L_d and −R/L_q."""
    cancelled = drive.resistance_ohm / min(winding.d_inductance_h, winding.q_inductance_h)
    return STABLE / max(winding.bandwidth_rad_s, cancelled)


@subroutine
def stays_within_voltage(
    winding: DqWinding, drive: MotorDrive, torque_n_m: float, dense: Vector, speed: int, place: int
) -> bool:
    """Whether a step's Bernstein coefficients, in whose hull it lies, prove that the bus never limits it."""
    i_d, i_q = _largest(dense[place]), _largest(dense[place + 1])
    u_d, u_q = _largest(dense[place + 2]), _largest(dense[place + 3])
    electrical = drive.pole_pairs * _largest(dense[speed])
    L_d, L_q, alpha = winding.d_inductance_h, winding.q_inductance_h, winding.bandwidth_rad_s
    d = u_d + alpha * L_d * i_d + electrical * L_q * i_q
    q = u_q + alpha * L_q * (abs(asked_current_a(drive, torque_n_m)) + i_q)
    q += electrical * (L_d * i_d + mean_flux_wb(drive))
    limit = voltage_limit_v(drive)
    within: bool = d * d + q * q < limit * limit
    return within


@subroutine
def _largest(b: Vector) -> float:
    largest = 0.0
    for i in range(b.size):
        largest = max(largest, abs(b[i]))
    return largest


def magnetic_energy_j(winding: DqWinding, i_d: float, i_q: float) -> float:
    """Energy of the currents' own fields, J: 3/4 (L_d i_d² + L_q i_q²)."""
    return 0.75 * (winding.d_inductance_h * i_d * i_d + winding.q_inductance_h * i_q * i_q)
