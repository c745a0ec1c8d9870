"""Windings: their currents, the torque on the crank, and the voltage limit of the current loop.

Windings in the rotor's frame have i_d, i_q and the two integrals of the current loop at `current_place` of
the state; at `terminal_place` the work at their terminals and the copper loss.
"""

import math
from typing import NamedTuple

from plant_sim.jets import ROW, Jet, State, Value, set_rate
from plant_sim.kernels import by_part, subroutine
from plant_sim.parts.drive import (
    MotorDrive,
    commanded_current_a,
    is_motor,
    motor_current_a,
    motor_torque_n_m,
    voltage_limit_v,
)
from plant_sim.parts.parts import Parts
from plant_sim.parts.winding import DqWinding, flux_wb, is_wound
from plant_sim.solvers.adaptive.event_location import Found, Segment, earlier, look_within, steepest
from plant_sim.solvers.adaptive.state_layout import Flow, Memory, Run
from plant_sim.solvers.bernstein import DEGREE, NODES, interpolate, root
from plant_sim.solvers.event import Event

STABLE = 4.5
"""h |λ| for which DOP853 damps a real pole well; its limit of stability is about 6."""


class Voltages(NamedTuple):
    """Voltages in the rotor's frame, V."""

    d: float
    q: float


@subroutine
def turning_current_a(parts: Parts, torque_n_m: float, omega_rad_s: float, y: State) -> float:
    """The torque-producing current i_q, A; it settles at once if the windings are not modelled."""
    if not is_wound(parts.winding):
        return motor_current_a(parts.drive, torque_n_m, omega_rad_s)
    current_a: float = y.i_q_a
    return current_a


@subroutine(inline=True)
def turning_torque_n_m(parts: Parts, torque_n_m: float, omega_rad_s: float, y: State) -> float:
    """The torque of the motor's current on the crank, N m, for the command `torque_n_m`."""
    winding, drive = parts.winding, parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return motor_torque_n_m(drive, torque_n_m, omega_rad_s)
    i_d, i_q = y.i_d_a, y.i_q_a
    saliency_h = winding.d_inductance_h - winding.q_inductance_h
    # T = 3/2 p (ψ i_q + (L_d − L_q) i_d i_q)
    torque: float = 1.5 * drive.pole_pairs * (flux_wb(drive) + saliency_h * i_d) * i_q
    return torque


@subroutine
def commanded_voltages(
    winding: DqWinding, drive: MotorDrive, torque_n_m: float, omega_rad_s: float, y: State
) -> Voltages:
    """The current loop's voltage command to the inverter, V."""
    i_d, i_q, u_d, u_q = y.i_d_a, y.i_q_a, y.u_d_v, y.u_q_v
    electrical = drive.pole_pairs * omega_rad_s
    L_d, L_q, alpha = winding.d_inductance_h, winding.q_inductance_h, winding.bandwidth_rad_s
    return Voltages(
        u_d - alpha * L_d * i_d - electrical * L_q * i_q,
        u_q
        + alpha * L_q * (commanded_current_a(drive, torque_n_m) - i_q)
        + electrical * (L_d * i_d + flux_wb(drive)),
    )


@subroutine
def voltage_excess(
    winding: DqWinding, drive: MotorDrive, torque_n_m: float, omega_rad_s: float, y: State
) -> float:
    """|v*|² − V²/3, V²: positive if the bus limits the current loop."""
    commanded = commanded_voltages(winding, drive, torque_n_m, omega_rad_s, y)
    limit = voltage_limit_v(drive)
    return commanded.d * commanded.d + commanded.q * commanded.q - limit * limit


@by_part
def set_winding_rates(jet: Jet, parts: Parts, flow: Flow, y: State) -> None:
    """Store the windings' rates; they have no series."""


@set_winding_rates.register(Value)
def _set_winding_rates(jet: Value, parts: Parts, flow: Flow, y: State) -> None:
    winding, drive = parts.winding, parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return
    torque_n_m, omega_rad_s = flow.torque_n_m, y.crank_rad_s
    i_d, i_q = y.i_d_a, y.i_q_a
    L_d, L_q, R = winding.d_inductance_h, winding.q_inductance_h, drive.resistance_ohm
    commanded = commanded_voltages(winding, drive, torque_n_m, omega_rad_s, y)
    share = 1.0
    if flow.voltage_limited:
        share = voltage_limit_v(drive) / math.sqrt(commanded.d * commanded.d + commanded.q * commanded.q)
    v_d, v_q = share * commanded.d, share * commanded.q
    electrical = drive.pole_pairs * omega_rad_s
    set_rate(jet, ROW.i_d_a, (v_d - R * i_d + electrical * L_q * i_q) / L_d)
    set_rate(jet, ROW.i_q_a, (v_q - R * i_q - electrical * (L_d * i_d + flux_wb(drive))) / L_q)
    # u' = α R (i* − i) + (R/L)(v − v*): the integral has no voltage beyond the bus
    alpha_R = winding.bandwidth_rad_s * R
    commanded_a = commanded_current_a(drive, torque_n_m)
    set_rate(jet, ROW.u_d_v, -alpha_R * i_d + R / L_d * (v_d - commanded.d))
    set_rate(jet, ROW.u_q_v, alpha_R * (commanded_a - i_q) + R / L_q * (v_q - commanded.q))
    set_rate(jet, ROW.terminal_j, 1.5 * (v_d * i_d + v_q * i_q))
    set_rate(jet, ROW.copper_j, 1.5 * R * (i_d * i_d + i_q * i_q))


@subroutine
def voltage_may_end(run: Run, segment: Segment) -> bool:
    """Whether the voltage command may exceed the bus within a step, by bounds as for other events.

    A function with slopes within ± S and values g0 and g1 at the ends has |g| ≤ (|g0| + |g1| + S h) / 2.
    """
    memory, winding, drive = run.memory[0], run.parts.winding, run.parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return False
    if segment.flow.voltage_limited:
        return True
    y, new, torque_n_m, h_s = memory.y, memory.new, segment.flow.torque_n_m, segment.h_s
    steep_speed = steepest(memory, segment, ROW.crank_rad_s)
    steep_d, steep_q = steepest(memory, segment, ROW.i_d_a), steepest(memory, segment, ROW.i_q_a)
    steep_u_d, steep_u_q = steepest(memory, segment, ROW.u_d_v), steepest(memory, segment, ROW.u_q_v)
    L_d, L_q, alpha = winding.d_inductance_h, winding.q_inductance_h, winding.bandwidth_rad_s
    fastest = drive.pole_pairs * (max(abs(y.crank_rad_s), abs(new.crank_rad_s)) + h_s * steep_speed)
    most_d = max(abs(y.i_d_a), abs(new.i_d_a)) + h_s * steep_d
    most_q = max(abs(y.i_q_a), abs(new.i_q_a)) + h_s * steep_q
    faster = drive.pole_pairs * steep_speed
    change_d = steep_u_d + alpha * L_d * steep_d + L_q * (faster * most_q + fastest * steep_q)
    change_q = (
        steep_u_q
        + alpha * L_q * steep_q
        + L_d * (faster * most_d + fastest * steep_d)
        + faster * flux_wb(drive)
    )
    before = commanded_voltages(winding, drive, torque_n_m, y.crank_rad_s, y)
    after = commanded_voltages(winding, drive, torque_n_m, new.crank_rad_s, new)
    d = 0.5 * (abs(before.d) + abs(after.d) + h_s * change_d)
    q = 0.5 * (abs(before.q) + abs(after.q) + h_s * change_q)
    limit = voltage_limit_v(drive)
    reached: bool = d * d + q * q >= limit * limit
    return reached


@subroutine
def current_s(parts: Parts) -> float:
    """Longest step for the windings, s: the method is stable to about h λ = −6.

    The loop's poles are −α and, where the integral cancels them, −R/L_d and −R/L_q.
    """
    winding, drive = parts.winding, parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return math.inf
    cancelled = drive.resistance_ohm / min(winding.d_inductance_h, winding.q_inductance_h)
    return STABLE / max(winding.bandwidth_rad_s, cancelled)


def magnetic_energy_j(winding: DqWinding, i_d: float, i_q: float) -> float:
    """Energy of the currents' magnetic fields, J: 3/4 (L_d i_d² + L_q i_q²)."""
    return 0.75 * (winding.d_inductance_h * i_d * i_d + winding.q_inductance_h * i_q * i_q)


@subroutine
def settle_voltage(run: Run) -> None:
    """Determine whether the bus limits the current loop from now on under this torque command."""
    parts, memory = run.parts, run.memory[0]
    winding, drive, y = parts.winding, parts.drive, memory.y
    if is_wound(winding) and is_motor(drive):
        excess = voltage_excess(winding, drive, memory.progress.torque_n_m, y.crank_rad_s, y)
        memory.mode.voltage_limited = 1 if excess > 0.0 else 0
        memory.mode.zero_voltage = 0


@subroutine
def limit_voltage(memory: Memory, is_limited: bool) -> None:
    """Begin or end the voltage limit of the current loop."""
    memory.mode.voltage_limited = 1 if is_limited else 0
    memory.mode.zero_voltage = 1


@subroutine
def voltage_events(run: Run, segment: Segment, found: Found) -> Found:
    """The earlier of `found` and the begin or end of the current loop's voltage limit."""
    parts, memory = run.parts, run.memory[0]
    winding, drive = parts.winding, parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return found
    flow, dense, scratch, inner = segment.flow, segment.dense, memory.scratch, memory.inner
    values, excess = scratch.poly, scratch.press[: DEGREE + 1]
    for i in range(DEGREE + 1):
        look_within(memory, dense, NODES[i], memory.all_inner)
        values[i] = voltage_excess(winding, drive, flow.torque_n_m, inner.crank_rad_s, inner)
    interpolate(values, excess)
    if flow.voltage_limited:
        return earlier(found, Event.UNLIMIT, root(excess, -1.0, 0.0, memory.mode.zero_voltage, scratch))
    return earlier(found, Event.LIMIT, root(excess, 1.0, 0.0, memory.mode.zero_voltage, scratch))
