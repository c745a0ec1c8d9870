"""The equations of motion of all parts within one phase.

m_B (x'' + a_b) = c (x_A + l0 − x) + F_f − F_stop, and those of crank, windings and foot plate.
"""

from typing import Any

from plant_sim.jets import (
    ROW,
    Coefficient,
    Jet,
    Rates,
    State,
    Value,
    constant,
    product,
    sine_and_cosine,
    steady_sine_and_cosine,
)
from plant_sim.kernels import by_part, subroutine
from plant_sim.parts.drive import is_motor
from plant_sim.parts.friction import friction_force_n, friction_loss_w
from plant_sim.parts.housing import Housing, housing_m_s2, is_level
from plant_sim.parts.linkage import piston_and_lever_m, piston_m
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_energy_j, elastic_force_n, is_soft, origin_m, stop_force_n
from plant_sim.parts.striker import spring_energy_j, spring_force_n
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.crank import crank_rates, rotor_energy_j
from plant_sim.solvers.adaptive.state_layout import Flow, Run, Vector, now_s
from plant_sim.solvers.adaptive.stop import in_touch
from plant_sim.solvers.adaptive.wearer import (
    closing_m_s,
    from_stop_m,
    plate_energy_j,
    plate_momentum_n_s,
    plate_rates,
)
from plant_sim.solvers.adaptive.winding import winding_rates


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
        is_pressed=is_soft(parts.stop) and in_touch(mode.phase, memory.y.depth_m),
        time_s=now_s(memory),
        voltage_limited=mode.voltage_limited == 1,
    )


@subroutine(inline=True)
def derivative(parts: Parts, flow: Flow, tau_s: float, y: State, out: Vector) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`, shape (state,)."""
    f = rates(parts, flow, Value(tau_s), y)
    out[ROW.depth_m] = f.depth_m
    out[ROW.v_m_s] = f.v_m_s
    out[ROW.crank_rad] = f.crank_rad
    out[ROW.crank_rad_s] = f.crank_rad_s
    out[ROW.plate_m] = f.plate_m
    out[ROW.plate_m_s] = f.plate_m_s
    out[ROW.i_d_a] = f.i_d_a
    out[ROW.i_q_a] = f.i_q_a
    out[ROW.u_d_v] = f.u_d_v
    out[ROW.u_q_v] = f.u_q_v
    out[ROW.drive_j] = f.drive_j
    out[ROW.friction_j] = f.friction_j
    out[ROW.stop_j] = f.stop_j
    out[ROW.impulse_n_s] = f.impulse_n_s
    out[ROW.housing_j] = f.housing_j
    out[ROW.ankle_j] = f.ankle_j
    out[ROW.terminal_j] = f.terminal_j
    out[ROW.copper_j] = f.copper_j


@subroutine(inline=True)
def rates(parts: Parts, flow: Flow, jet: Jet, y: Any) -> State:
    """Time derivative of the state, or its k-th Taylor coefficients from those of the state."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    v, closing = y.v_m_s, closing_m_s(y)
    if is_motor(drive):
        sine, cosine = sine_and_cosine(jet, y.crank_rad, ROW.crank_rad_s)
    else:
        sine, cosine = steady_sine_and_cosine(jet, flow.angle_rad, drive.omega_rad_s)
    piston, lever = piston_and_lever_m(parts.linkage, drive.amplitude_m, sine, cosine)
    reach = constant(jet, striker.rest_length_m - origin_m(stop, striker))
    spring = spring_force_n(striker, piston + reach - from_stop_m(y))
    load = product(jet, ROW.spring_n, spring, ROW.lever_m, lever)
    crank = crank_rates(parts, jet, flow, load, y)
    a_b = housing_power = 0.0
    if not is_level(parts.housing):
        a_b = housing_rate_m_s2(jet, parts.housing, flow.time_s)
        momentum = striker.mass_kg * v + plate_momentum_n_s(parts, y)
        housing_power = -product(jet, ROW.housing_m_s2, a_b, ROW.momentum_n_s, momentum)
    push = stop_loss = 0.0
    if flow.is_pressed:
        elastic = elastic_force_n(stop, y.depth_m)
        push = stop_force_n(stop, elastic, closing, flow.damping_s_m)
        stop_loss = product(jet, ROW.damping_n, push - elastic, ROW.closing_m_s, closing)
    depth_rate = acceleration = friction_loss = 0.0
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        normal_n = striker.mass_kg * striker.gravity_m_s2
        drag = friction_force_n(parts.friction, jet, normal_n, v, flow.direction)
        friction_loss = friction_loss_w(parts.friction, jet, drag, normal_n, v, flow.direction)
        depth_rate = closing
        acceleration = (spring - push + drag) * (
            1.0 / striker.mass_kg
        ) - a_b  # a division would be waited for
    plate_rate, plate_acceleration, ankle_loss = plate_rates(parts, jet, push, a_b, y)
    winding = winding_rates(jet, parts, flow, y)
    result: State = Rates(
        depth_m=depth_rate,
        v_m_s=acceleration,
        crank_rad=crank.angle,
        crank_rad_s=crank.speed,
        plate_m=plate_rate,
        plate_m_s=plate_acceleration,
        i_d_a=winding.i_d,
        i_q_a=winding.i_q,
        u_d_v=winding.u_d,
        u_q_v=winding.u_q,
        drive_j=crank.drive_w,
        friction_j=crank.loss_w + friction_loss,
        stop_j=stop_loss,
        impulse_n_s=push,
        housing_j=housing_power,
        ankle_j=ankle_loss,
        terminal_j=winding.terminal_w,
        copper_j=winding.copper_w,
    )
    return result


@by_part
def housing_rate_m_s2(jet: Any, housing: Housing, begin_s: float) -> float:
    """a_b, m/s²; a series has its coefficients in a row of its own from its beginning."""
    return housing_m_s2(housing, begin_s + jet.tau_s)


@housing_rate_m_s2.register(Coefficient)
def _housing_rate_m_s2(jet: Coefficient, housing: Housing, begin_s: float) -> float:
    return float(jet.rows[ROW.housing_m_s2, jet.k])


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
