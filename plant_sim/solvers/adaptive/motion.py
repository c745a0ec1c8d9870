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
    rotor_energy_j,
)
from plant_sim.solvers.adaptive.state_layout import Flow, Run, State, now_s
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
def flow_now(run: Run) -> Flow:
    """Constants of the step that begins now."""
    parts, memory = run.parts, run.memory[0]
    mode = memory.mode
    return Flow(
        phase=mode.phase,
        direction=float(mode.direction),
        damping_s_m=memory.contact.damping_s_m if is_soft(parts.stop) else 0.0,
        angle_rad=memory.y.crank_rad,
        torque_n_m=memory.held.torque_n_m,
        crank_direction=float(mode.crank_direction),
        crank_stuck=mode.crank_stuck == 1,
        time_s=now_s(memory),
        voltage_limited=mode.voltage_limited == 1,
    )


@subroutine(inline=True)
def derivative(parts: Parts, flow: Flow, tau_s: float, y: State, out: State) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`."""
    striker, drive, friction, stop = parts.striker, parts.drive, parts.friction, parts.stop
    depth, v = y.depth_m, y.v_m_s
    crank = crank_in_stage(drive, flow, tau_s, y)
    spring = coupling_n(parts, crank.angle_rad, from_stop_m(y))
    load = crank_torque_n_m(parts.linkage, spring, drive.amplitude_m, crank.angle_rad)
    torque = turning_torque_n_m(parts, flow.torque_n_m, crank, y)
    crank_loss = crank_derivative(drive, flow, torque, load, crank, out)
    closing = closing_m_s(y)
    a_b = housing_m_s2(parts.housing, flow.time_s + tau_s)
    out.stop_j = out.impulse_n_s = 0.0
    elastic = 0.0
    push = 0.0
    if is_soft(stop) and in_touch(flow.phase, depth):
        elastic = elastic_force_n(stop, depth)
        push = stop_force_n(stop, elastic, closing, flow.damping_s_m)
        out.stop_j = (push - elastic) * closing
        out.impulse_n_s = push
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        drag = friction_force_n(friction, striker.mass_kg * striker.gravity_m_s2, v, flow.direction)
        out.depth_m = closing
        out.v_m_s = (spring - push + drag) * (1.0 / striker.mass_kg) - a_b  # a division would be waited for
        out.friction_j = crank_loss - drag * v
    else:
        out.depth_m = 0.0
        out.v_m_s = 0.0
        out.friction_j = crank_loss
    plate_derivative(parts, push, a_b, y, out)
    if not is_level(parts.housing):
        momentum = striker.mass_kg * v + plate_momentum_n_s(parts, y)
        out.housing_j = -a_b * momentum
    winding_derivative(parts, flow, crank, y, out)


@subroutine
def stored_energy_j(parts: Parts, phase: int, y: State) -> float:
    """Energy, J, in striker, coupling spring, stop's spring, rotor, foot plate and ankle."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    depth_m, v_m_s = y.depth_m, y.v_m_s
    piston = piston_m(parts.linkage, drive.amplitude_m, y.crank_rad)
    place_m = from_stop_m(y)
    stretch = piston + striker.rest_length_m - origin_m(stop, striker) - place_m
    energy: float = 0.5 * striker.mass_kg * v_m_s * v_m_s + spring_energy_j(striker, stretch)
    if in_touch(phase, depth_m):
        energy += elastic_energy_j(stop, depth_m)
    energy += plate_energy_j(parts, y)
    return energy + rotor_energy_j(drive, y.crank_rad_s)
