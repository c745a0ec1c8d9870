"""The equations of motion within one phase, and where each quantity sits in the integrated state.

m_B x'' = c (A sin θ + l0 − x) + F_f − F_stop;  J θ'' = T − T_viscous − T_dry − c (A sin θ + l0 − x) A cos θ.

The state holds only what the parts have: depth and velocity; the crank's angle and speed with a motor; then
the ledger's integrals: work of the drive, friction, with a stop its loss, with a soft one its impulse. Depth
is x − x_stop, so that it keeps its digits at the stop.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import by_part, law, subroutine
from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive, motor_current_a
from plant_sim.parts.friction import friction_force_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import (
    HuntCrossley,
    KelvinVoigt,
    NoStop,
    RigidStop,
    Stop,
    elastic_energy_j,
    elastic_force_n,
    is_soft,
    origin_m,
    stop_force_n,
)
from plant_sim.result import Phase

Vector = NDArray[np.float64]

FLIGHT, STICK, REST, CONTACT = (int(phase) for phase in Phase)

DEPTH, VELOCITY, ANGLE, SPEED = range(4)
"""Places of the motion; those of the ledger's integrals follow from `work_place` on."""


class Flow(NamedTuple):
    """What does not change within one step."""

    phase: int
    direction: float
    """Of the striker's sliding, ±1."""
    damping_s_m: float
    """λ of the present contact."""
    angle_rad: float
    """Of an ideal drive's crank at the step's start."""
    torque_n_m: float
    """Commanded to a motor."""
    crank_direction: float
    """Of a turning crank with dry loss, ±1; else 0."""
    crank_stuck: bool


@by_part
def work_place(drive: Drive) -> int:
    """Place of the drive's work in the state; friction's follows, then the stop's loss and impulse."""
    raise NotImplementedError


@law(work_place, IdealDrive)
def _(drive: IdealDrive) -> int:
    return 2


@law(work_place, MotorDrive)
def _(drive: MotorDrive) -> int:
    return 4


@by_part
def integrals(stop: Stop) -> int:
    """How many of the ledger's integrals a scene with this stop has."""
    raise NotImplementedError


@law(integrals, NoStop)
def _(stop: NoStop) -> int:
    return 2


@law(integrals, RigidStop)
def _(stop: RigidStop) -> int:
    return 3


@law(integrals, KelvinVoigt, HuntCrossley)
def _(stop: KelvinVoigt | HuntCrossley) -> int:
    return 4


@subroutine
def state_size(parts: Parts) -> int:
    """Length of the integrated state."""
    return work_place(parts.drive) + integrals(parts.stop)


@by_part
def crank(drive: Drive, flow: Flow, tau_s: float, y: Vector) -> tuple[float, float]:
    """Crank angle, rad, and speed, rad/s, `tau_s` after the step's start."""
    raise NotImplementedError


@law(crank, IdealDrive)
def _(drive: IdealDrive, flow: Flow, tau_s: float, y: Vector) -> tuple[float, float]:
    return flow.angle_rad + drive.omega_rad_s * tau_s, drive.omega_rad_s


@law(crank, MotorDrive)
def _(drive: MotorDrive, flow: Flow, tau_s: float, y: Vector) -> tuple[float, float]:
    return y[2], y[3]


@by_part
def crank_derivative(drive: Drive, flow: Flow, load_n_m: float, omega_rad_s: float, out: Vector) -> float:
    """Fill in the crank's part of the derivative and the drive's power, W; returns the crank's loss, W."""
    raise NotImplementedError


@law(crank_derivative, IdealDrive)
def _(drive: IdealDrive, flow: Flow, load_n_m: float, omega_rad_s: float, out: Vector) -> float:
    out[2] = load_n_m * omega_rad_s
    return 0.0


@law(crank_derivative, MotorDrive)
def _(drive: MotorDrive, flow: Flow, load_n_m: float, omega_rad_s: float, out: Vector) -> float:
    if flow.crank_stuck:
        out[2] = 0.0
        out[3] = 0.0
        out[4] = 0.0
        return 0.0
    torque_n_m = drive.torque_constant_n_m_a * motor_current_a(drive, flow.torque_n_m, omega_rad_s)
    loss_n_m = drive.viscous_n_m_s * omega_rad_s + drive.dry_n_m * flow.crank_direction
    out[2] = omega_rad_s
    out[3] = (torque_n_m - loss_n_m - load_n_m) / drive.inertia_kg_m2
    out[4] = torque_n_m * omega_rad_s
    return loss_n_m * omega_rad_s


@subroutine
def derivative(parts: Parts, flow: Flow, tau_s: float, y: Vector, out: Vector) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`."""
    striker, drive, friction, stop = parts
    depth, v = y[0], y[1]
    theta, omega = crank(drive, flow, tau_s, y)
    reach = striker.rest_length_m - origin_m(stop, striker)
    spring = striker.spring_n_m * (drive.amplitude_m * math.sin(theta) + reach - depth)
    load = spring * drive.amplitude_m * math.cos(theta)
    crank_loss = crank_derivative(drive, flow, load, omega, out)
    work = work_place(drive)
    for place in range(work + 2, work + integrals(stop)):
        out[place] = 0.0
    elastic = 0.0
    push = 0.0
    if is_soft(stop) and in_touch(flow.phase, depth):
        elastic = elastic_force_n(stop, depth)
        push = stop_force_n(stop, elastic, v, flow.damping_s_m)
        out[work + 2] = (push - elastic) * v
        out[work + 3] = push
    if flow.phase in (FLIGHT, CONTACT):
        drag = friction_force_n(friction, striker.mass_kg * striker.gravity_m_s2, v, flow.direction)
        out[0] = v
        out[1] = (spring + drag - push) / striker.mass_kg
        out[work + 1] = crank_loss - drag * v
    else:
        out[0] = 0.0
        out[1] = 0.0
        out[work + 1] = crank_loss


@subroutine
def in_touch(phase: int, depth_m: float) -> bool:
    """Whether a soft stop presses on the striker in this phase."""
    return phase == CONTACT or (phase == STICK and depth_m > 0.0)


@subroutine
def held_force_n(parts: Parts, theta_rad: float, depth_m: float) -> float:
    """Force, N, on a striker at rest there, apart from dry friction and from a rigid stop."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    reach = striker.rest_length_m - origin_m(stop, striker)
    spring = striker.spring_n_m * (drive.amplitude_m * math.sin(theta_rad) + reach - depth_m)
    return spring - elastic_force_n(stop, max(depth_m, 0.0))


@subroutine
def crank_load_n_m(parts: Parts, theta_rad: float, depth_m: float) -> float:
    """Torque, N m, that the coupling spring takes from the crank: c (A sin θ + l0 − x) A cos θ."""
    striker, amplitude_m = parts.striker, parts.drive.amplitude_m
    reach = striker.rest_length_m - origin_m(parts.stop, striker)
    spring = striker.spring_n_m * (amplitude_m * math.sin(theta_rad) + reach - depth_m)
    return spring * amplitude_m * math.cos(theta_rad)


@by_part
def rotor_energy_j(drive: Drive, omega_rad_s: float) -> float:
    """Kinetic energy, J, of what the motor turns; an ideal drive's is its own affair."""
    raise NotImplementedError


@law(rotor_energy_j, IdealDrive)
def _(drive: IdealDrive, omega_rad_s: float) -> float:
    return 0.0


@law(rotor_energy_j, MotorDrive)
def _(drive: MotorDrive, omega_rad_s: float) -> float:
    return 0.5 * drive.inertia_kg_m2 * omega_rad_s * omega_rad_s


@subroutine
def stored_energy_j(
    parts: Parts, phase: int, depth_m: float, v_m_s: float, theta_rad: float, omega_rad_s: float
) -> float:
    """Energy, J, in the striker, the coupling spring, the stop's spring and the rotor."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    stretch = (
        drive.amplitude_m * math.sin(theta_rad) + striker.rest_length_m - origin_m(stop, striker) - depth_m
    )
    energy = 0.5 * striker.mass_kg * v_m_s * v_m_s + 0.5 * striker.spring_n_m * stretch * stretch
    if in_touch(phase, depth_m):
        energy += elastic_energy_j(stop, depth_m)
    return energy + rotor_energy_j(drive, omega_rad_s)
