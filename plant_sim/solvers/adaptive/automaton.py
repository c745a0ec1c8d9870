"""The hybrid automaton of striker, crank and current loop: phases, the events that end them, transitions.

FLIGHT ── touch ──▶ impact at a rigid stop ──▶ FLIGHT, or REST_ON_STOP after the last rebound
       ── touch ──▶ CONTACT with a soft stop ── leave ──▶ FLIGHT
FLIGHT, CONTACT ── halt ──▶ STICK, or sliding the other way
STICK, REST_ON_STOP ── release ──▶ FLIGHT or CONTACT
"""

from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_force_n, has_stop, is_soft, stop_force_n
from plant_sim.parts.wearer import is_worn
from plant_sim.sensors.sensing import Probe
from plant_sim.solvers.adaptive.crank import crank_events, crank_may_halt, halt_or_break_crank, settle_crank
from plant_sim.solvers.adaptive.event_location import (
    CLEAR,
    CRANK_BREAK,
    CRANK_HALT,
    HALT,
    LEAVE,
    LIMIT,
    NONE,
    PRESS,
    RELEASE,
    TOUCH,
    UNLIMIT,
    Course,
    Found,
    Step,
    Zeros,
    earlier,
    root,
    steepest,
)
from plant_sim.solvers.adaptive.state_layout import (
    CONTACT,
    FLIGHT,
    IN_CONTACT,
    LET_GO,
    NO_IMPACT,
    REST,
    STICK,
    VELOCITY,
    Flow,
    Memory,
    Vector,
)
from plant_sim.solvers.adaptive.stiction import dry_limit_n, from_rest, release, release_event
from plant_sim.solvers.adaptive.stop import (
    come_to_rest,
    leave,
    leaving_zeros,
    open_contact,
    press_again,
    rebound,
    record_contact,
    stop_events,
)
from plant_sim.solvers.adaptive.wearer import closing_m_s
from plant_sim.solvers.adaptive.winding import limit_voltage, voltage_events, voltage_may_end
from plant_sim.solvers.bernstein import NO_ROOT


@subroutine
def settle(parts: Parts, memory: Memory, torque_n_m: float, time_s: float) -> None:
    """Determine the phase of a module after a restart or a change from outside."""
    y, mode, stop = memory.y, memory.mode[0], parts.stop
    settle_crank(parts.drive, parts, memory, torque_n_m)
    mode.phase = FLIGHT
    mode.direction = 1 if y[1] > 0.0 else -1
    if is_soft(stop) and y[0] > 0.0:
        lets_go = LET_GO
        if mode.in_impact == NO_IMPACT:
            lets_go = NO_IMPACT
            open_contact(parts, memory, time_s, 0)
        mode.phase = CONTACT
        mode.in_impact = IN_CONTACT
        closing = closing_m_s(parts.wearer, parts.drive, y)
        if stop_force_n(stop, elastic_force_n(stop, y[0]), closing, memory.contact[0].damping_s_m) < 0.0:
            memory.contact[0].leave_m_s = closing
            mode.phase = FLIGHT
            mode.in_impact = lets_go
    elif is_soft(stop) and mode.in_impact != NO_IMPACT:  # taken out of it from outside
        memory.contact[0].leave_m_s = closing_m_s(parts.wearer, parts.drive, y)
        record_contact(parts, memory)
    if y[1] == 0.0:
        from_rest(parts, memory, time_s)
    elif y[0] == 0.0 and y[1] < 0.0:
        mode.zero_depth = 1


@subroutine
def may_end(
    parts: Parts, flow: Flow, h_s: float, y: Vector, new: Vector, course: Course, zeros: Zeros
) -> bool:
    """Whether an event may occur in the step, by bounds from its ends and its largest slopes.

    A function with slopes within ± S and values g0 and g1 at the ends is at least (g0 + g1 − S h) / 2.
    """
    if is_worn(parts.wearer) or flow.phase != FLIGHT or zeros.depth + zeros.velocity + zeros.crank > 0:
        return True
    change = h_s * steepest(course, VELOCITY)
    if dry_limit_n(parts) > 0.0 and (y[1] + new[1]) * flow.direction <= change:
        return True
    if has_stop(parts.stop) and max(y[0], new[0]) + 0.125 * h_s * change >= 0.0:
        return True
    return crank_may_halt(parts.drive, flow, h_s, y, new, course) or voltage_may_end(
        parts.winding, parts.drive, parts, flow, h_s, y, new, course
    )


@subroutine
def first_event(parts: Parts, step: Step) -> Found:
    """The first event of a step."""
    flow = step.flow
    found = crank_events(parts.drive, parts, step, Found(NONE, NO_ROOT))
    found = voltage_events(parts.winding, parts.drive, parts, step, found)
    if flow.phase in (STICK, REST):
        return earlier(found, RELEASE, release_event(parts.housing, parts, step))
    if dry_limit_n(parts) > 0.0:
        s = root(step.dense[VELOCITY], -flow.direction, 0.0, step.zeros.velocity, step.scratch)
        found = earlier(found, HALT, s)
    return stop_events(parts.stop, parts, step, found)


@subroutine
def apply(parts: Parts, probe: Probe, memory: Memory, torque_n_m: float, event: int, time_s: float) -> None:
    """Apply an event to the state."""
    if event == TOUCH:
        _touch(parts, probe, memory, time_s)
    elif event == PRESS:
        press_again(parts, memory, time_s)
    elif event == LEAVE:
        leave(parts, memory)
    elif event == CLEAR:
        memory.y[0] = 0.0
        memory.mode[0].zero_depth = 1
        if memory.mode[0].in_impact == LET_GO:
            record_contact(parts, memory)
    elif event == HALT:
        memory.y[1] = 0.0
        from_rest(parts, memory, time_s)
    elif event == RELEASE:
        release(parts, memory, time_s)
    elif event in (CRANK_HALT, CRANK_BREAK):
        halt_or_break_crank(parts.drive, parts, memory, torque_n_m, event)
    elif event in (LIMIT, UNLIMIT):
        limit_voltage(parts.winding, memory, event)


@subroutine
def _touch(parts: Parts, probe: Probe, memory: Memory, time_s: float) -> None:
    """Treat the striker's arrival at the stop's surface, depth 0, from outside."""
    y, mode = memory.y, memory.mode[0]
    y[0] = 0.0
    v = closing_m_s(parts.wearer, parts.drive, y)
    if v < 0.0:  # a graze that rounding made an event
        mode.zero_depth = 1
    elif v == 0.0 and y[1] != 0.0:  # striker and plate side by side
        mode.zero_depth = 2
    elif v == 0.0:
        from_rest(parts, memory, time_s)
    elif is_soft(parts.stop):
        open_contact(parts, memory, time_s, leaving_zeros(parts.stop))
    else:
        rebound(parts, probe, memory, time_s)
        if y[1] > -memory.held[0].rest_m_s:
            come_to_rest(parts, memory)
            from_rest(parts, memory, time_s)
