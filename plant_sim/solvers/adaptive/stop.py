"""Impacts at a stop: the events that begin and end an impact, their effects, and the impact's record.

An impact at a rigid stop takes no time; one at a soft stop is a contact. The law of the stop's force is in
`plant_sim.parts.stop`.
"""

import math

from plant_sim.jets import ROW
from plant_sim.kernels import subroutine
from plant_sim.parts.housing import shock_m_s
from plant_sim.parts.stop import (
    Stop,
    contact_rate_rad_s,
    damping_s_m,
    elastic_energy_j,
    has_no_stop,
    is_soft,
    release_s,
    restitution,
)
from plant_sim.parts.wearer import contact_mass_kg, is_worn
from plant_sim.result import Phase
from plant_sim.sensors.sensing import sense_jump
from plant_sim.solvers.adaptive.event_location import Found, Segment, earlier
from plant_sim.solvers.adaptive.state_layout import IN_CONTACT, LET_GO, NO_IMPACT, Run, enter, now_s
from plant_sim.solvers.adaptive.wearer import closing_m_s
from plant_sim.solvers.bernstein import root
from plant_sim.solvers.event import Event

SURFACE_SHARE = 1e-3
"""Distance from the surface, as a share of a step's tolerance, of a striker that leaves it from rest."""


@subroutine
def in_touch(phase: int, depth_m: float) -> bool:
    """Whether a soft stop presses on the striker in this phase."""
    return phase == Phase.CONTACT or (phase == Phase.STICK and depth_m > 0.0)


@subroutine
def stop_events(run: Run, segment: Segment, found: Found) -> Found:
    """The earlier of `found` and the stop's own event.

    A soft stop's force ends where δ + (D/K) δ' reaches 0: with a linear damper before its surface, otherwise
    there. A striker that was released before the surface clears it, or presses the stop again.
    """
    parts, memory = run.parts, run.memory[0]
    phase, zeros, scratch = segment.flow.phase, memory.mode.zero_depth, memory.scratch
    if has_no_stop(parts.stop) or phase not in (Phase.FLIGHT, Phase.CONTACT):
        return found
    dense = segment.dense
    depth = dense[ROW.depth_m]
    beyond = phase == Phase.FLIGHT and is_soft(parts.stop) and depth[0] > 0.0
    if phase == Phase.FLIGHT and not beyond:
        return earlier(found, Event.TOUCH, root(depth, 1.0, 0.0, zeros, scratch))
    press, early_s = scratch.press[: depth.size], release_s(parts.stop)
    for i in range(depth.size):
        press[i] = depth[i] + early_s * (dense[ROW.v_m_s, i] - dense[ROW.plate_m_s, i])  # F/K
    if not beyond:
        return earlier(found, Event.LEAVE, root(press, -1.0, 0.0, zeros, scratch))
    found = earlier(found, Event.CLEAR, root(depth, -1.0, 0.0, 0, scratch))
    return earlier(found, Event.PRESS, root(press, 1.0, 0.0, zeros, scratch))


@subroutine
def leaving_zeros(stop: Stop) -> int:
    """Number of leading zero derivatives, at the begin of a contact, of the quantity whose root ends it."""
    return 0 if release_s(stop) > 0.0 else 1


@subroutine
def rebound(run: Run) -> None:
    """Newton's law: v⁺ = −k v⁻."""
    parts, memory = run.parts, run.memory[0]
    mass, k = parts.striker.mass_kg, restitution(parts.stop)
    v = memory.y.v_m_s
    memory.y.v_m_s = -k * v
    memory.y.stop_j += 0.5 * mass * v * v * (1.0 - k * k)
    enter(memory.mode, Phase.FLIGHT, -1, 1, 0)
    _record(run, now_s(memory), v, -k * v, mass * (1.0 + k) * v, math.nan, memory.y.crank_rad)
    sense_jump(run.probe, (1.0 + k) * v)


@subroutine
def come_to_rest(run: Run) -> None:
    """End a rebound at a rigid stop in rest; its energy counts as loss of the impact."""
    memory = run.memory[0]
    loss = 0.5 * run.parts.striker.mass_kg * memory.y.v_m_s * memory.y.v_m_s
    memory.y.stop_j += loss
    memory.y.v_m_s = 0.0


@subroutine
def open_contact(run: Run, zeros: int) -> None:
    """Begin a contact with a soft stop; `zeros` is as in `leaving_zeros`."""
    parts, memory = run.parts, run.memory[0]
    y, mode, contact = memory.y, memory.mode, memory.contact
    enter(mode, Phase.CONTACT, mode.direction, zeros, mode.zero_velocity)
    mode.in_impact = IN_CONTACT
    speed = max(closing_m_s(y), 0.0)
    contact.touch_s = now_s(memory)
    contact.touch_m_s = speed
    contact.touch_rad = y.crank_rad
    contact.damping_s_m = damping_s_m(parts.stop, speed)
    # In a stiff stop an error of position weighs as much as one of velocity does within the contact.
    mass = contact_mass_kg(parts.wearer, parts.striker.mass_kg)
    rate = contact_rate_rad_s(parts.stop, mass, speed)
    memory.contact_scale.depth_m = min(memory.scale.depth_m, memory.contact_scale.v_m_s / rate)
    contact.peak_n = 0.0
    contact.impulse_before_n_s = y.impulse_n_s


@subroutine
def follow_disturbance(run: Run, coming_m_s: float) -> None:
    """Give a contact that a disturbance has made faster, or makes faster by `coming_m_s`, the damping of its
    speed.

    The speed is that of an impact from the stop's surface with the present energy: √(v² + 2 E/m).
    """
    parts, memory = run.parts, run.memory[0]
    y, contact = memory.y, memory.contact
    closing = max(closing_m_s(y) + coming_m_s, 0.0)
    mass = contact_mass_kg(parts.wearer, parts.striker.mass_kg)
    speed = math.sqrt(closing * closing + 2.0 * elastic_energy_j(parts.stop, y.depth_m) / mass)
    contact.damping_s_m = min(contact.damping_s_m, damping_s_m(parts.stop, speed))


@subroutine
def follow_shock(run: Run) -> None:
    """Give a contact in which a shock of the housing begins the damping of the speed that it brings.

    A plate is shaken as the striker is.
    """
    parts, memory = run.parts, run.memory[0]
    if memory.mode.in_impact == IN_CONTACT and not is_worn(parts.wearer):
        change_m_s = shock_m_s(parts.housing, now_s(memory))
        if change_m_s != 0.0:
            follow_disturbance(run, -change_m_s)


@subroutine
def press_again(run: Run) -> None:
    """Press a stop again that released early and has not been cleared: its spring stores energy again.

    The earlier contact continues.
    """
    memory = run.memory[0]
    mode = memory.mode
    memory.y.stop_j -= elastic_energy_j(run.parts.stop, memory.y.depth_m)
    if mode.in_impact == NO_IMPACT:
        open_contact(run, 1)
        return
    enter(mode, Phase.CONTACT, mode.direction, 1, mode.zero_velocity)
    mode.in_impact = IN_CONTACT


@subroutine
def part_from_surface(run: Run) -> None:
    """Let a striker at rest on the surface set off just outside it.

    Which power of time its motion begins with, and so how many derivatives are zero, only the step shows.
    """
    memory = run.memory[0]
    mode = memory.mode
    memory.y.depth_m = -SURFACE_SHARE * memory.scale.depth_m
    enter(mode, Phase.FLIGHT, mode.direction, 0, mode.zero_velocity)


@subroutine
def leave(run: Run) -> None:
    """End the stop's force; the elastic energy of a stop that releases early is lost as it relaxes.

    The impact ends where the striker clears the stop's surface; until then the stop may be pressed again.
    """
    parts, memory = run.parts, run.memory[0]
    y, mode = memory.y, memory.mode
    lets_go_early = leaving_zeros(parts.stop) == 0
    if not lets_go_early:
        y.depth_m = 0.0
    y.stop_j += elastic_energy_j(parts.stop, y.depth_m)
    closing = closing_m_s(y)
    enter(mode, Phase.FLIGHT, mode.direction, 1 if closing < 0.0 else 2, mode.zero_velocity)
    mode.in_impact = LET_GO
    memory.contact.leave_m_s = closing
    if closing == 0.0 and y.depth_m == 0.0 and memory.contact.touch_m_s == 0.0:
        part_from_surface(run)
        mode.in_impact = NO_IMPACT
        return
    if not lets_go_early:
        record_contact(run)


@subroutine
def record_contact(run: Run) -> None:
    """Record the impact of a contact that has ended."""
    memory = run.memory[0]
    contact = memory.contact
    memory.mode.in_impact = NO_IMPACT
    _record(
        run,
        contact.touch_s,
        contact.touch_m_s,
        contact.leave_m_s,
        memory.y.impulse_n_s - contact.impulse_before_n_s,
        contact.peak_n,
        contact.touch_rad,
    )


@subroutine
def _record(
    run: Run,
    time_s: float,
    approach_m_s: float,
    rebound_m_s: float,
    impulse_n_s: float,
    peak_force_n: float,
    angle_rad: float,
) -> None:
    mode = run.memory[0].mode
    row = run.impacts[mode.impacts]
    row.t_s, row.v_m_s, row.v_after_m_s = time_s, approach_m_s, rebound_m_s
    row.impulse_n_s, row.peak_force_n, row.crank_rad = impulse_n_s, peak_force_n, angle_rad
    mode.impacts += 1
