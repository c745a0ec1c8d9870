"""The hybrid automaton of striker, crank and current loop: phases, the events that end them, transitions.

FLIGHT ── touch ──▶ impact at a rigid stop ──▶ FLIGHT, or REST_ON_STOP after the last rebound
       ── touch ──▶ CONTACT with a soft stop ── leave ──▶ FLIGHT
FLIGHT, CONTACT ── halt ──▶ STICK, or sliding the other way
STICK, REST_ON_STOP ── release ──▶ FLIGHT or CONTACT
"""

from plant_sim.jets import ROW
from plant_sim.kernels import subroutine
from plant_sim.parts.stop import elastic_force_n, has_no_stop, is_soft, stop_force_n
from plant_sim.parts.wearer import is_worn
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.crank import (
    break_crank_away,
    crank_events,
    crank_may_halt,
    halt_crank,
    settle_crank,
)
from plant_sim.solvers.adaptive.event_location import Found, Segment, earlier, steepest
from plant_sim.solvers.adaptive.state_layout import IN_CONTACT, LET_GO, NO_IMPACT, Run, enter
from plant_sim.solvers.adaptive.stiction import dry_limit_n, from_rest, release, release_event
from plant_sim.solvers.adaptive.stop import (
    come_to_rest,
    follow_disturbance,
    leave,
    leaving_zeros,
    open_contact,
    part_from_surface,
    press_again,
    rebound,
    record_contact,
    stop_events,
)
from plant_sim.solvers.adaptive.wearer import closing_m_s
from plant_sim.solvers.adaptive.winding import limit_voltage, voltage_events, voltage_may_end
from plant_sim.solvers.bernstein import NO_ROOT, root
from plant_sim.solvers.event import Event


@subroutine
def determine_phase(run: Run) -> None:
    """Enter the phases that follow from the state alone: at a start and after a disturbance.

    Only an impact at a soft stop continues, if the striker is still in it.
    """
    memory = run.memory[0]
    y, mode = memory.y, memory.mode
    memory.progress.last_step_s = 0.0
    settle_crank(run)
    closing = closing_m_s(y)
    enter(mode, Phase.FLIGHT, 1 if y.v_m_s > 0.0 else -1, 1 if y.depth_m == 0.0 and closing < 0.0 else 0, 0)
    if is_soft(run.parts.stop):
        _determine_contact(run, closing)
    if y.v_m_s == 0.0:
        from_rest(run)


@subroutine
def _determine_contact(run: Run, closing: float) -> None:
    """Begin, continue or end an impact at a soft stop, from the state alone."""
    memory, stop = run.memory[0], run.parts.stop
    y, mode, contact = memory.y, memory.mode, memory.contact
    if y.depth_m < 0.0 or (y.depth_m == 0.0 and closing <= 0.0):
        if mode.in_impact != NO_IMPACT:
            contact.leave_m_s = closing
            record_contact(run)
        return
    before = mode.in_impact
    zeros = leaving_zeros(stop) if y.depth_m == 0.0 else 0
    if before == NO_IMPACT:
        open_contact(run, zeros)
    else:
        enter(mode, Phase.CONTACT, mode.direction, zeros, 0)
        mode.in_impact = IN_CONTACT
    if y.depth_m > 0.0:
        follow_disturbance(run, 0.0)
    if stop_force_n(stop, elastic_force_n(stop, y.depth_m), closing, contact.damping_s_m) < 0.0:
        contact.leave_m_s = closing
        enter(mode, Phase.FLIGHT, mode.direction, 0, 0)
        mode.in_impact = NO_IMPACT if before == NO_IMPACT else LET_GO


@subroutine
def may_end(run: Run, segment: Segment) -> bool:
    """Whether an event may occur in the step, by bounds from its ends and its largest slopes.

    A function with slopes within ± S and values g0 and g1 at the ends is at least (g0 + g1 − S h) / 2.
    """
    parts, memory, flow = run.parts, run.memory[0], segment.flow
    y, new, mode = memory.y, memory.new, memory.mode
    if (
        is_worn(parts.wearer)
        or flow.phase != Phase.FLIGHT
        or mode.zero_depth + mode.zero_velocity + mode.zero_crank > 0
    ):
        return True
    change = segment.h_s * steepest(memory, segment, ROW.v_m_s)
    if dry_limit_n(parts) > 0.0 and (y.v_m_s + new.v_m_s) * flow.direction <= change:
        return True
    if not has_no_stop(parts.stop) and max(y.depth_m, new.depth_m) + 0.125 * segment.h_s * change >= 0.0:
        return True
    return crank_may_halt(run, segment) or voltage_may_end(run, segment)


@subroutine
def first_event(run: Run, segment: Segment) -> Found:
    """The first event of a step."""
    parts, memory, flow = run.parts, run.memory[0], segment.flow
    found = crank_events(run, segment, Found(Event.NONE, NO_ROOT))
    found = voltage_events(run, segment, found)
    if flow.phase in (Phase.STICK, Phase.REST_ON_STOP):
        return earlier(found, Event.RELEASE, release_event(run, segment))
    if dry_limit_n(parts) > 0.0:
        s = root(segment.dense[ROW.v_m_s], -flow.direction, 0.0, memory.mode.zero_velocity, memory.scratch)
        found = earlier(found, Event.HALT, s)
    return stop_events(run, segment, found)


@subroutine
def apply(run: Run, event: Event) -> None:
    """Apply an event to the state."""
    memory = run.memory[0]
    if event == Event.TOUCH:
        _touch(run)
    elif event == Event.PRESS:
        press_again(run)
    elif event == Event.LEAVE:
        leave(run)
    elif event == Event.CLEAR:
        memory.y.depth_m = 0.0
        mode = memory.mode
        enter(mode, mode.phase, mode.direction, 1, mode.zero_velocity)
        if mode.in_impact == LET_GO:
            record_contact(run)
    elif event == Event.HALT:
        memory.y.v_m_s = 0.0
        from_rest(run)
    elif event == Event.RELEASE:
        release(run)
    elif event == Event.CRANK_HALT:
        halt_crank(run)
    elif event == Event.CRANK_BREAK:
        break_crank_away(run)
    elif event in (Event.LIMIT, Event.UNLIMIT):
        limit_voltage(memory, event == Event.LIMIT)


@subroutine
def _touch(run: Run) -> None:
    """Treat the striker's arrival at the stop's surface, depth 0, from outside."""
    parts, memory = run.parts, run.memory[0]
    y, mode = memory.y, memory.mode
    y.depth_m = 0.0
    v = closing_m_s(y)
    if v < 0.0:  # a graze that rounding made an event
        enter(mode, mode.phase, mode.direction, 1, mode.zero_velocity)
    elif v == 0.0 and y.v_m_s != 0.0:  # striker and plate side by side
        enter(mode, mode.phase, mode.direction, 2, mode.zero_velocity)
    elif v == 0.0:
        from_rest(run)
        if mode.phase == Phase.FLIGHT:
            part_from_surface(run)
    elif is_soft(parts.stop):
        open_contact(run, leaving_zeros(parts.stop))
    else:
        rebound(run)
        if y.v_m_s > -memory.progress.rest_m_s:
            come_to_rest(run)
            from_rest(run)
