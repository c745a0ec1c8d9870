"""The equations of motion of all parts within one phase.

m_B (x'' + a_b) = c (x_A + l0 − x) + F_f − F_stop, and those of crank, windings and foot plate.
"""

from plant_sim.kernels import subroutine
from plant_sim.parts.friction import friction_force_n
from plant_sim.parts.housing import housing_m_s2, is_level
from plant_sim.parts.linkage import crank_torque_n_m, piston_m
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_energy_j, elastic_force_n, is_soft, origin_m, stop_force_n
from plant_sim.parts.striker import spring_energy_j
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.crank import (
    coupling_n,
    crank_derivative,
    crank_in_stage,
    crank_now,
    rotor_energy_j,
)
from plant_sim.solvers.adaptive.state_layout import Crank, Flow, Memory, Vector, housing_place, work_place
from plant_sim.solvers.adaptive.stop import in_touch
from plant_sim.solvers.adaptive.wearer import (
    closing_m_s,
    from_stop_m,
    plate_derivative,
    plate_energy_j,
    plate_momentum_n_s,
)
from plant_sim.solvers.adaptive.winding import turning_torque_n_m, winding_derivative


@subroutine
def flow_now(parts: Parts, memory: Memory, torque_n_m: float, time_s: float) -> Flow:
    """Constants of the step that begins now."""
    mode = memory.mode[0]
    return Flow(
        phase=mode.phase,
        direction=float(mode.direction),
        damping_s_m=memory.contact[0].damping_s_m if is_soft(parts.stop) else 0.0,
        angle_rad=crank_now(parts, memory).angle_rad,
        torque_n_m=torque_n_m,
        crank_direction=float(mode.crank_direction),
        crank_stuck=mode.crank_stuck == 1,
        time_s=time_s,
        voltage_limited=mode.voltage_limited == 1,
    )


@subroutine(inline=True)
def derivative(parts: Parts, flow: Flow, tau_s: float, y: Vector, out: Vector) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`."""
    striker, drive, friction, stop = parts.striker, parts.drive, parts.friction, parts.stop
    depth, v = y[0], y[1]
    crank = crank_in_stage(drive, flow, tau_s, y)
    spring = coupling_n(parts, crank.angle_rad, from_stop_m(parts, y))
    load = crank_torque_n_m(parts.linkage, spring, drive.amplitude_m, crank.angle_rad)
    work = work_place(parts)
    torque = turning_torque_n_m(parts, flow.torque_n_m, crank, y)
    crank_loss = crank_derivative(drive, flow, torque, load, crank, work, out)
    closing = closing_m_s(parts, y)
    a_b = housing_m_s2(parts.housing, flow.time_s + tau_s)
    for account in range(work + 2, housing_place(parts)):
        out[account] = 0.0
    elastic = 0.0
    push = 0.0
    if is_soft(stop) and in_touch(flow.phase, depth):
        elastic = elastic_force_n(stop, depth)
        push = stop_force_n(stop, elastic, closing, flow.damping_s_m)
        out[work + 2] = (push - elastic) * closing
        out[work + 3] = push
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        drag = friction_force_n(friction, striker.mass_kg * striker.gravity_m_s2, v, flow.direction)
        out[0] = closing
        out[1] = (spring - push + drag) * (1.0 / striker.mass_kg) - a_b  # a division would be waited for
        out[work + 1] = crank_loss - drag * v
    else:
        out[0] = 0.0
        out[1] = 0.0
        out[work + 1] = crank_loss
    plate_derivative(parts, push, a_b, y, out)
    if not is_level(parts.housing):
        momentum = striker.mass_kg * v + plate_momentum_n_s(parts, y)
        out[housing_place(parts)] = -a_b * momentum
    winding_derivative(parts, flow, crank, y, out)


@subroutine
def stored_energy_j(parts: Parts, phase: int, y: Vector, crank: Crank) -> float:
    """Energy, J, in striker, coupling spring, stop's spring, rotor, foot plate and ankle."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    depth_m, v_m_s = y[0], y[1]
    piston = piston_m(parts.linkage, drive.amplitude_m, crank.angle_rad)
    place_m = from_stop_m(parts, y)
    stretch = piston + striker.rest_length_m - origin_m(stop, striker) - place_m
    energy: float = 0.5 * striker.mass_kg * v_m_s * v_m_s + spring_energy_j(striker, stretch)
    if in_touch(phase, depth_m):
        energy += elastic_energy_j(stop, depth_m)
    energy += plate_energy_j(parts, y)
    return energy + rotor_energy_j(drive, crank.speed_rad_s)
