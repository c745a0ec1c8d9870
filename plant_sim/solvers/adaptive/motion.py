"""The equations of motion within one phase, and where each quantity sits in the integrated state.

m_B (x'' + a_b) = c (x_A + l0 − x) + F_f − F_stop;  J θ'' = T − T_viscous − T_dry − c (x_A + l0 − x) dx_A/dθ;
m_f (p'' + a_b) = F_stop − k_a p − d_a p'.

The state holds only what the parts have: depth and velocity; the crank's angle and speed with a motor; the
foot plate's place and velocity with a wearer; with windings their currents and the current loop's integrals;
then the ledger's integrals: work of the drive, friction, with a stop its loss, with a soft one its impulse,
with a tilted or moving housing its work, with a wearer the ankle's loss, with windings the work at their
terminals and the copper's loss. Depth is x − x_stop − p, so that it keeps its digits at the stop.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import by_part, law, shared, subroutine
from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive
from plant_sim.parts.friction import ROUNDING, friction_force_n, static_limit_n
from plant_sim.parts.housing import Housing, Moving, Tilted, housing_m_s2
from plant_sim.parts.linkage import crank_torque_n_m, piston_m
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
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import Ankle, NoWearer, Wearer
from plant_sim.parts.winding import cogging_energy_j, cogging_n_m
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.currents import (
    turning_torque_n_m,
    winding_derivative,
    winding_integrals,
    winding_size,
)

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
    time_s: float
    """At the step's start."""
    voltage_limited: bool
    """Whether the bus limits a current loop."""


@by_part
def plate_place(drive: Drive) -> int:
    """Place of the foot plate's way in the state, which its velocity follows, where there is a wearer."""
    raise NotImplementedError


@law(plate_place, IdealDrive)
def _(drive: IdealDrive) -> int:
    return 2


@law(plate_place, MotorDrive)
def _(drive: MotorDrive) -> int:
    return 4


@by_part
def plate_size(wearer: Wearer) -> int:
    """How many quantities of motion a wearer adds."""
    return 0


@law(plate_size, Ankle)
def _(wearer: Ankle) -> int:
    return 2


@shared
def current_place(parts: Parts) -> int:
    """Place of the windings' currents in the state, where it has them."""
    return plate_place(parts.drive) + plate_size(parts.wearer)


@shared
def work_place(parts: Parts) -> int:
    """Place of the drive's work in the state; friction's follows, then the stop's loss and impulse."""
    return current_place(parts) + winding_size(parts.winding)


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


@by_part
def housing_integrals(housing: Housing) -> int:
    """How many of the ledger's integrals a housing has."""
    return 0


@law(housing_integrals, Tilted, Moving, Walking)
def _(housing: Tilted | Moving | Walking) -> int:
    return 1


@by_part
def wearer_integrals(wearer: Wearer) -> int:
    """How many of the ledger's integrals a wearer has."""
    return 0


@law(wearer_integrals, Ankle)
def _(wearer: Ankle) -> int:
    return 1


@shared
def housing_place(parts: Parts) -> int:
    """Place of the housing's work in the state, where it is not level and at rest."""
    return work_place(parts) + integrals(parts.stop)


@shared
def ankle_place(parts: Parts) -> int:
    """Place of the ankle's loss in the state, where there is a wearer."""
    return housing_place(parts) + housing_integrals(parts.housing)


@shared
def terminal_place(parts: Parts) -> int:
    """Place of the work at a motor's terminals in the state, where it has windings."""
    return ankle_place(parts) + wearer_integrals(parts.wearer)


@shared
def state_size(parts: Parts) -> int:
    """Length of the integrated state."""
    return terminal_place(parts) + winding_integrals(parts.winding)


@by_part
def from_stop_m(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """The striker's place from where the scene puts the stop, m."""
    raise NotImplementedError


@law(from_stop_m, NoWearer)
def _(wearer: NoWearer, drive: Drive, y: Vector) -> float:
    depth_m: float = y[0]
    return depth_m


@law(from_stop_m, Ankle)
def _(wearer: Ankle, drive: Drive, y: Vector) -> float:
    place_m: float = y[0] + y[plate_place(drive)]
    return place_m


@by_part
def closing_m_s(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """The striker's velocity against the stop's surface, m/s: how fast depth grows."""
    raise NotImplementedError


@law(closing_m_s, NoWearer)
def _(wearer: NoWearer, drive: Drive, y: Vector) -> float:
    v_m_s: float = y[1]
    return v_m_s


@law(closing_m_s, Ankle)
def _(wearer: Ankle, drive: Drive, y: Vector) -> float:
    v_m_s: float = y[1] - y[plate_place(drive) + 1]
    return v_m_s


@by_part
def felt_force_n(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """Force of spring and damper of the ankle on the wearer, N: k_a p + d_a p'."""
    return 0.0


@law(felt_force_n, Ankle)
def _(wearer: Ankle, drive: Drive, y: Vector) -> float:
    place = plate_place(drive)
    force_n: float = wearer.stiffness_n_m * y[place] + wearer.damping_n_s_m * y[place + 1]
    return force_n


@by_part
def plate_momentum_n_s(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """m_f p', N s."""
    return 0.0


@law(plate_momentum_n_s, Ankle)
def _(wearer: Ankle, drive: Drive, y: Vector) -> float:
    momentum_n_s: float = wearer.plate_kg * y[plate_place(drive) + 1]
    return momentum_n_s


@by_part
def plate_energy_j(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """Energy of plate and ankle spring, J."""
    return 0.0


@law(plate_energy_j, Ankle)
def _(wearer: Ankle, drive: Drive, y: Vector) -> float:
    p, v = y[plate_place(drive)], y[plate_place(drive) + 1]
    energy_j: float = 0.5 * (wearer.plate_kg * v * v + wearer.stiffness_n_m * p * p)
    return energy_j


@by_part
def _plate_derivative(
    wearer: Wearer, parts: Parts, push_n: float, a_b: float, y: Vector, out: Vector
) -> None:
    return


@law(_plate_derivative, Ankle)
def _(wearer: Ankle, parts: Parts, push_n: float, a_b: float, y: Vector, out: Vector) -> None:
    place = plate_place(parts.drive)
    v = y[place + 1]
    out[place] = v
    out[place + 1] = (push_n - felt_force_n(wearer, parts.drive, y)) / wearer.plate_kg - a_b
    out[ankle_place(parts)] = wearer.damping_n_s_m * v * v


@by_part
def _housing_derivative(housing: Housing, parts: Parts, a_b: float, y: Vector, out: Vector) -> None:
    return


@law(_housing_derivative, Tilted, Moving, Walking)
def _(housing: Tilted | Moving | Walking, parts: Parts, a_b: float, y: Vector, out: Vector) -> None:
    momentum = parts.striker.mass_kg * y[1] + plate_momentum_n_s(parts.wearer, parts.drive, y)
    out[housing_place(parts)] = -a_b * momentum


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
def crank_derivative(
    drive: Drive, flow: Flow, torque_n_m: float, load_n_m: float, omega_rad_s: float, work: int, out: Vector
) -> float:
    """Fill in the crank's part of the derivative and the drive's power, W; returns the crank's loss, W."""
    raise NotImplementedError


@law(crank_derivative, IdealDrive)
def _(
    drive: IdealDrive,
    flow: Flow,
    torque_n_m: float,
    load_n_m: float,
    omega_rad_s: float,
    work: int,
    out: Vector,
) -> float:
    out[work] = load_n_m * omega_rad_s
    return 0.0


@law(crank_derivative, MotorDrive)
def _(
    drive: MotorDrive,
    flow: Flow,
    torque_n_m: float,
    load_n_m: float,
    omega_rad_s: float,
    work: int,
    out: Vector,
) -> float:
    if flow.crank_stuck:
        out[2] = 0.0
        out[3] = 0.0
        out[work] = 0.0
        return 0.0
    loss_n_m = drive.viscous_n_m_s * omega_rad_s + drive.dry_n_m * flow.crank_direction
    out[2] = omega_rad_s
    out[3] = (torque_n_m - loss_n_m - load_n_m) / drive.inertia_kg_m2
    out[work] = torque_n_m * omega_rad_s
    return loss_n_m * omega_rad_s


@subroutine
def derivative(parts: Parts, flow: Flow, tau_s: float, y: Vector, out: Vector) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`."""
    striker, drive, friction, stop = parts.striker, parts.drive, parts.friction, parts.stop
    depth, v = y[0], y[1]
    theta, omega = crank(drive, flow, tau_s, y)
    reach = striker.rest_length_m - origin_m(stop, striker)
    piston = piston_m(parts.linkage, drive.amplitude_m, theta)
    spring = striker.spring_n_m * (piston + reach - from_stop_m(parts.wearer, drive, y))
    load = crank_torque_n_m(parts.linkage, spring, drive.amplitude_m, theta)
    work = work_place(parts)
    place = current_place(parts)
    torque = turning_torque_n_m(parts.winding, drive, flow.torque_n_m, theta, omega, y, place)
    held_back = load - cogging_n_m(parts.winding, theta)
    crank_loss = crank_derivative(drive, flow, torque, held_back, omega, work, out)
    closing = closing_m_s(parts.wearer, drive, y)
    a_b = housing_m_s2(parts.housing, flow.time_s + tau_s)
    for account in range(work + 2, work + integrals(stop)):
        out[account] = 0.0
    elastic = 0.0
    push = 0.0
    if is_soft(stop) and in_touch(flow.phase, depth):
        elastic = elastic_force_n(stop, depth)
        push = stop_force_n(stop, elastic, closing, flow.damping_s_m)
        out[work + 2] = (push - elastic) * closing
        out[work + 3] = push
    if flow.phase in (FLIGHT, CONTACT):
        drag = friction_force_n(friction, striker.mass_kg * striker.gravity_m_s2, v, flow.direction)
        out[0] = closing
        out[1] = (spring - push + drag) * (1.0 / striker.mass_kg) - a_b  # a division would be waited for
        out[work + 1] = crank_loss - drag * v
    else:
        out[0] = 0.0
        out[1] = 0.0
        out[work + 1] = crank_loss
    _plate_derivative(parts.wearer, parts, push, a_b, y, out)
    _housing_derivative(parts.housing, parts, a_b, y, out)
    winding_derivative(
        parts.winding,
        drive,
        flow.torque_n_m,
        flow.voltage_limited,
        theta,
        omega,
        y,
        place,
        terminal_place(parts),
        out,
    )


@subroutine
def in_touch(phase: int, depth_m: float) -> bool:
    """Whether a soft stop presses on the striker in this phase."""
    return phase == CONTACT or (phase == STICK and depth_m > 0.0)


@subroutine
def held_force_n(parts: Parts, theta_rad: float, y: Vector, time_s: float) -> float:
    """Force, N, on a striker at rest there, without dry friction and a rigid stop."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    reach = striker.rest_length_m - origin_m(stop, striker)
    piston = piston_m(parts.linkage, drive.amplitude_m, theta_rad)
    spring = striker.spring_n_m * (piston + reach - from_stop_m(parts.wearer, drive, y))
    inertia = striker.mass_kg * housing_m_s2(parts.housing, time_s)
    return spring - elastic_force_n(stop, max(y[0], 0.0)) - inertia


@subroutine
def held_limit_n(parts: Parts, y: Vector, time_s: float) -> float:
    """Largest `held_force_n` on a striker that stays at rest: friction's limit and the force's rounding."""
    striker, stop = parts.striker, parts.stop
    limit = static_limit_n(parts.friction, striker.mass_kg * striker.gravity_m_s2)
    reach = abs(striker.rest_length_m - origin_m(stop, striker))
    reach += abs(from_stop_m(parts.wearer, parts.drive, y))
    spring = striker.spring_n_m * (parts.drive.amplitude_m + reach)
    inertia = striker.mass_kg * abs(housing_m_s2(parts.housing, time_s))
    return limit + ROUNDING * (spring + elastic_force_n(stop, max(y[0], 0.0)) + inertia + limit)


@subroutine
def crank_load_n_m(parts: Parts, theta_rad: float, place_m: float) -> float:
    """Torque, N m, that the coupling spring takes from the crank, the striker `place_m` from the stop.

    c (x_A + l0 − x) dx_A/dθ.
    """
    striker, amplitude_m = parts.striker, parts.drive.amplitude_m
    reach = striker.rest_length_m - origin_m(parts.stop, striker)
    spring = striker.spring_n_m * (piston_m(parts.linkage, amplitude_m, theta_rad) + reach - place_m)
    return crank_torque_n_m(parts.linkage, spring, amplitude_m, theta_rad)


@subroutine
def crank_net_n_m(parts: Parts, torque_n_m: float, angle_rad: float, y: Vector) -> float:
    """Torque, N m, on a crank at rest at `angle_rad`, without its dry loss."""
    place = current_place(parts)
    torque = turning_torque_n_m(parts.winding, parts.drive, torque_n_m, angle_rad, 0.0, y, place)
    load = crank_load_n_m(parts, angle_rad, from_stop_m(parts.wearer, parts.drive, y))
    return torque + cogging_n_m(parts.winding, angle_rad) - load


@subroutine
def crank_limit_n_m(parts: Parts, dry_n_m: float, torque_n_m: float, angle_rad: float, y: Vector) -> float:
    """Largest net torque, N m, at which the dry loss holds a crank at rest: the loss and a net's rounding."""
    load = crank_load_n_m(parts, angle_rad, from_stop_m(parts.wearer, parts.drive, y))
    return dry_n_m + ROUNDING * (abs(torque_n_m) + abs(load) + dry_n_m)


@by_part
def rotor_energy_j(drive: Drive, omega_rad_s: float) -> float:
    """Kinetic energy, J, of what the motor turns; an ideal drive's is its own affair."""
    return 0.0


@law(rotor_energy_j, MotorDrive)
def _(drive: MotorDrive, omega_rad_s: float) -> float:
    return 0.5 * drive.inertia_kg_m2 * omega_rad_s * omega_rad_s


@subroutine
def stored_energy_j(parts: Parts, phase: int, y: Vector, theta_rad: float, omega_rad_s: float) -> float:
    """Energy, J, in striker, coupling spring, stop's spring, rotor, cogging, foot plate and ankle."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    depth_m, v_m_s = y[0], y[1]
    piston = piston_m(parts.linkage, drive.amplitude_m, theta_rad)
    place_m = from_stop_m(parts.wearer, drive, y)
    stretch = piston + striker.rest_length_m - origin_m(stop, striker) - place_m
    energy: float = 0.5 * striker.mass_kg * v_m_s * v_m_s + 0.5 * striker.spring_n_m * stretch * stretch
    if in_touch(phase, depth_m):
        energy += elastic_energy_j(stop, depth_m)
    energy += plate_energy_j(parts.wearer, drive, y)
    energy += cogging_energy_j(parts.winding, theta_rad)
    return energy + rotor_energy_j(drive, omega_rad_s)
