"""The equations of motion of all parts within one phase.

m_B (x'' + a_b) = c (x_A + l0 − x) + F_f − F_stop, and those of crank, windings and foot plate.
"""

from typing import Any

from plant_sim.arrays import FloatArray
from plant_sim.jets import (
    ROW,
    Coefficient,
    Jet,
    State,
    Value,
    constant,
    product,
    set_rate,
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
from plant_sim.solvers.adaptive.crank import rotor_energy_j, set_crank_rates
from plant_sim.solvers.adaptive.state_layout import Flow, Run, now_s
from plant_sim.solvers.adaptive.stop import in_touch
from plant_sim.solvers.adaptive.wearer import (
    closing_m_s,
    from_stop_m,
    plate_energy_j,
    plate_momentum_n_s,
    set_plate_rates,
)
from plant_sim.solvers.adaptive.winding import set_winding_rates


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
        torque_n_m=memory.progress.torque_n_m,
        crank_direction=float(mode.crank_direction),
        crank_stuck=mode.crank_stuck == 1,
        is_pressed=is_soft(parts.stop) and in_touch(mode.phase, memory.y.depth_m),
        time_s=now_s(memory),
        voltage_limited=mode.voltage_limited == 1,
    )


@subroutine(inline=True)
def derivative(parts: Parts, flow: Flow, tau_s: float, y: State, out: FloatArray) -> None:
    """Time derivative of the state `tau_s` after the step's start, into `out`, shape (state,)."""
    set_rates(parts, flow, Value(tau_s, out), y)


@subroutine(inline=True)
def set_rates(parts: Parts, flow: Flow, jet: Jet, y: Any) -> tuple[float, float]:
    """Store the rates of all quantities, or their coefficients; return those of depth and velocity."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    v, closing = y.v_m_s, closing_m_s(y)
    if is_motor(drive):
        sine, cosine = sine_and_cosine(jet, y.crank_rad, ROW.crank_rad_s)
    else:
        sine, cosine = steady_sine_and_cosine(jet, flow.angle_rad, drive.omega_rad_s)
    piston, lever = piston_and_lever_m(parts.linkage, drive.amplitude_m, sine, cosine)
    reach = constant(jet, striker.rest_length_m - origin_m(stop, striker))
    spring = spring_force_n(striker, piston + reach - from_stop_m(y))
    loss = set_crank_rates(parts, jet, flow, product(jet, ROW.spring_n, spring, ROW.lever_m, lever), y)
    a_b = push = stop_loss = depth_rate = acceleration = 0.0
    if not is_level(parts.housing):
        a_b = housing_rate_m_s2(jet, parts.housing, flow.time_s)
        momentum = striker.mass_kg * v + plate_momentum_n_s(parts, y)
        set_rate(jet, ROW.housing_j, -product(jet, ROW.housing_m_s2, a_b, ROW.momentum_n_s, momentum))
    if flow.is_pressed:
        elastic = elastic_force_n(stop, y.depth_m)
        push = stop_force_n(stop, elastic, closing, flow.damping_s_m)
        stop_loss = product(jet, ROW.damping_n, push - elastic, ROW.closing_m_s, closing)
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        normal_n = striker.mass_kg * striker.gravity_m_s2
        drag = friction_force_n(parts.friction, jet, normal_n, v, flow.direction)
        loss += friction_loss_w(parts.friction, jet, drag, normal_n, v, flow.direction)
        per_kg = 1.0 / striker.mass_kg  # a division takes longer than a product
        depth_rate, acceleration = closing, (spring - push + drag) * per_kg - a_b
    set_rate(jet, ROW.depth_m, depth_rate)
    set_rate(jet, ROW.v_m_s, acceleration)
    set_rate(jet, ROW.friction_j, loss)
    set_rate(jet, ROW.stop_j, stop_loss)
    set_rate(jet, ROW.impulse_n_s, push)
    set_plate_rates(parts, jet, push, a_b, y)
    set_winding_rates(jet, parts, flow, y)
    return depth_rate, acceleration


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
