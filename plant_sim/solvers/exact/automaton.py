"""The striker as a hybrid automaton: flow until the next event, apply its transition, repeat.

    FLIGHT        closed-form motion; leaves by TOUCH, or with dry friction by HALT (the speed reaches zero)
    STICK         dry friction holds; leaves by RELEASE, up or down, when the spring overcomes it
    REST_ON_STOP  pressed on the stop; leaves by RELEASE, down, when the spring pulls it off

            TOUCH: rebound             HALT: |push| ≤ μ m g            RELEASE up, on the stop
    FLIGHT ───────────────▶ FLIGHT   FLIGHT ─────────────▶ STICK   STICK ───────────────▶ REST_ON_STOP
           ───────────────▶ REST_ON_STOP    ◀───────────── STICK         ◀─────────────── REST_ON_STOP
            plastic or end of chatter          RELEASE                         RELEASE with dry friction
    FLIGHT ◀─────────────── REST_ON_STOP: RELEASE without dry friction

A striker that sticks has no speed and therefore cannot meet the stop. Every function here is pure and
compiled, so that studies can run this loop inside kernels of their own:

    motion, scratch = begin(o, t_s, x − l0, v, crank), new_scratch()
    while True:
        arrival, event = next_event(o, motion, until_s, scratch)
        …a study's evaluation of `motion`, `arrival` and `event`…
        if event == Event.NONE: break
        motion = after(o, arrival, event, rest_speed_m_s)
"""

import math
from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.parts.friction import ROUNDING, set_off
from plant_sim.result import Phase
from plant_sim.solvers.bernstein import Scratch
from plant_sim.solvers.double_double import TURN_RAD, add, turn_by
from plant_sim.solvers.event import Event
from plant_sim.solvers.exact.crossing import (
    LEAST_SPAN,
    backing,
    event_near,
    first_crossing,
    overlap,
    point_after,
    return_s,
)
from plant_sim.solvers.exact.oscillator import Flight, Oscillator, Point, flow, launch, point

CERTAIN = 1e-3  # share of the pressing acceleration that may change until chatter is over
RESOLVED = 4e-15  # least height of a bounce over the position's scale: some roundings
UNIT_ROUNDOFF = 2.3e-16
LEAST_SPEED_M_S = 1e-100
HALF_PI = 0.5 * math.pi


class Motion(NamedTuple):
    """The module at one instant; time and crank angle in two floats each, the angle in [−π, π]."""

    t_s: float
    t_low_s: float
    crank_rad: float
    crank_low_rad: float
    sin_crank: float
    cos_crank: float
    y_m: float
    v_m_s: float
    phase: Phase
    direction: float  # of sliding with dry friction, or of a release: ±1; 0 otherwise
    poised: bool  # just released: the net force is exactly zero


@subroutine
def begin(o: Oscillator, t_s: float, y_m: float, v_m_s: float, crank_rad: float) -> Motion:
    """The motion from a state at or before the stop."""
    crank, crank_low = turn_by(crank_rad, 0.0, 0.0, 0.0, 0.0)
    motion = Motion(
        t_s=t_s,
        t_low_s=0.0,
        crank_rad=crank,
        crank_low_rad=crank_low,
        sin_crank=math.sin(crank),
        cos_crank=math.cos(crank),
        y_m=y_m,
        v_m_s=v_m_s,
        phase=Phase.FLIGHT,
        direction=0.0,
        poised=False,
    )
    return _moving(o, motion, y_m, v_m_s)


@subroutine
def _moving(o: Oscillator, m: Motion, y: float, v: float) -> Motion:
    """The motion from a place and a speed at the time of `m`: its phase follows from them and the force."""
    if abs(v) < LEAST_SPEED_M_S:
        v = 0.0  # its square would vanish
    push = o.amplitude_m * m.sin_crank - y  # spring force over c
    dry, rounding = o.dry_offset_m, _rounding_m(o, y)
    phase, direction = Phase.FLIGHT, 0.0
    if v == 0.0:
        is_on_stop = o.has_stop and y >= o.gap_m
        stays = set_off(push, dry, rounding, 0.0, is_on_stop) == 0  # `_wait` finds the release
        if stays and dry > 0.0 and push <= dry + rounding:
            phase = Phase.STICK
        elif stays and is_on_stop:
            phase = Phase.REST_ON_STOP
    if phase == Phase.FLIGHT and o.is_dry:
        direction = math.copysign(1.0, v if v != 0.0 else push)
    return m._replace(y_m=y, v_m_s=v, phase=phase, direction=direction, poised=False)


@subroutine
def _rounding_m(o: Oscillator, y: float) -> float:
    """The rounding error of a force on a striker at rest, which does not set it in motion."""
    return ROUNDING * (o.amplitude_m + abs(y) + o.dry_offset_m)


@subroutine
def next_event(o: Oscillator, motion: Motion, until_s: float, scratch: Scratch) -> tuple[Motion, Event]:
    """The motion just before the first event up to `until_s`, and that event."""
    if motion.phase == Phase.FLIGHT:
        return _fly(o, motion, until_s, scratch)
    return _wait(o, motion, until_s)


@subroutine
def _arrive(o: Oscillator, motion: Motion, duration: float, y: float, v: float) -> Motion:
    t, t_low = add(motion.t_s, motion.t_low_s, duration)
    crank, crank_low = turn_by(motion.crank_rad, motion.crank_low_rad, o.drive_rad_s, 0.0, duration)
    return motion._replace(
        t_s=t,
        t_low_s=t_low,
        crank_rad=crank,
        crank_low_rad=crank_low,
        sin_crank=math.sin(crank),
        cos_crank=math.cos(crank),
        y_m=y,
        v_m_s=v,
        poised=False,
    )


@subroutine
def _at_horizon(o: Oscillator, motion: Motion, until_s: float, y: float, v: float) -> Motion:
    span = (until_s - motion.t_s) - motion.t_low_s
    there = _arrive(o, motion, span, y, v)
    return there._replace(t_s=until_s, t_low_s=0.0, poised=motion.poised and span <= 0.0)


@subroutine
def _wait(o: Oscillator, motion: Motion, until_s: float) -> tuple[Motion, Event]:
    """Stick or rest until the spring's force exceeds friction's limit: A sin θ = y ± μ m g / c."""
    A, y, dry = o.amplitude_m, motion.y_m, o.dry_offset_m
    turning = A - _rounding_m(
        o, y
    )  # where the piston turns round, the push may exceed the limit by a rounding
    rising = motion.crank_rad >= -HALF_PI and motion.cos_crank >= 0.0
    crank = motion.crank_rad if motion.crank_rad >= -HALF_PI else motion.crank_rad + TURN_RAD
    turn_up, turn_down = math.inf, math.inf
    if motion.phase == Phase.REST_ON_STOP:
        level = y + dry
        if level > -turning:
            turn_down = max(0.0, ((math.pi - _level_angle(level, A)) - crank) - motion.crank_low_rad)
    else:
        if y + dry < turning:
            angle = _level_angle(y + dry, A)
            if not rising:
                angle += TURN_RAD
            turn_up = max(0.0, (angle - crank) - motion.crank_low_rad)
        if y - dry > -turning:
            turn_down = max(0.0, ((math.pi - _level_angle(y - dry, A)) - crank) - motion.crank_low_rad)
    turn = min(turn_up, turn_down)
    if turn < math.inf and o.drive_rad_s > 0.0:
        arrival = _arrive(o, motion, turn / o.drive_rad_s, y, 0.0)
        if arrival.t_s <= until_s:
            return arrival._replace(direction=1.0 if turn_up < turn_down else -1.0), Event.RELEASE
    return _at_horizon(o, motion, until_s, y, 0.0), Event.NONE


@subroutine
def _level_angle(level: float, amplitude: float) -> float:
    """asin(level / amplitude), accurate near ±π/2 and clipped beyond."""
    return math.atan2(level, math.sqrt(max(0.0, (amplitude - level) * (amplitude + level))))


@subroutine
def quiet_from_s(o: Oscillator, flight: Flight) -> float:
    """Time after the start of a flight without dry friction from which on it stays clear of the stop, s."""
    room = o.gap_m - o.steady_m
    if o.resonant or not room > 0.0 or not o.ringing_rad_s > 0.1 * o.natural_rad_s:
        return math.inf
    amplitude = math.hypot(flight.free_m, (flight.free_m_s + o.decay_1_s * flight.free_m) / o.ringing_rad_s)
    if amplitude < room * (1.0 - 1e-12):
        return 0.0
    return math.log(amplitude / (room * (1.0 - 1e-12))) / o.decay_1_s if o.decay_1_s > 0.0 else math.inf


@subroutine
def _fly(o: Oscillator, motion: Motion, until_s: float, scratch: Scratch) -> tuple[Motion, Event]:
    """Fly to the stop or the turn, from span to span; each ends where an event may occur first.

    There the event is located if it is surely near; otherwise a shorter span decides.
    """
    direction = motion.direction
    if o.has_stop and motion.y_m >= o.gap_m and motion.v_m_s > 0.0:
        return _arrive(o, motion, 0.0, o.gap_m, motion.v_m_s), Event.TOUCH
    end = (until_s - motion.t_s) - motion.t_low_s
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, direction)
    here = point(o, flight, 0.0, motion.y_m, motion.v_m_s, 0.0, 1.0)
    if motion.poised or (motion.v_m_s == 0.0 and direction * here.a_m_s2 < 0.0):
        here = here._replace(a_m_s2=0.0)  # just released: rounding must not push it back
    first_period, least = TURN_RAD / o.natural_rad_s, LEAST_SPAN / o.fastest_1_s
    last = end + UNIT_ROUNDOFF * abs(until_s)  # an event whose time rounds to the end belongs to the run
    scan_end = last if o.has_stop or o.is_dry else -1.0
    # At the least speeds the guess rounds to 0, and a span of 0 would never end.
    span = max(_first_span_s(o, here, direction), 2.0 * least)
    while here.h_s < scan_end:
        there = point_after(o, flight, here, span)  # beyond the end, too: events do not depend on it
        crossing = first_crossing(o, here, there, direction, scratch)
        found, is_clear = False, crossing.s > 1.0
        if is_clear:
            span = min(2.0 * span, o.span_s)
        else:
            near = point_after(o, flight, here, crossing.s * span)
            found, there = event_near(o, flight, near, direction, crossing.at_stop)
            if not found and crossing.s * span < least:  # it touches zero within rounding
                there = point_after(o, flight, here, least)
                found = there.overlap_m > 0.0 if crossing.at_stop else direction * there.v_m_s < 0.0
            span = max(0.5 * span, 2.0 * least)
        if found:
            y, v = (o.gap_m, there.v_m_s) if crossing.at_stop else (min(there.y_m, o.gap_m), 0.0)
            arrival = _arrive(o, motion, there.h_s, y, v)
            if arrival.t_s <= until_s:
                return arrival, Event.TOUCH if crossing.at_stop else Event.HALT
            break
        if not o.is_dry and here.h_s < first_period <= there.h_s:
            scan_end = min(last, quiet_from_s(o, flight))
        here = there
    y, v, _, _ = flow(o, flight, end)
    return _at_horizon(o, motion, until_s, min(y, o.gap_m), v), Event.NONE


@subroutine
def _first_span_s(o: Oscillator, here: Point, direction: float) -> float:
    """The span in which a flight's event is first looked for, s: somewhat more than a short bounce takes."""
    soon = math.inf
    if o.has_stop:
        soon = return_s(overlap(here))
    if o.is_dry:
        soon = min(soon, return_s(backing(here, direction)))
    return min(1.25 * soon, o.span_s)


@subroutine
def after(o: Oscillator, arrival: Motion, event: Event, rest_speed_m_s: float) -> Motion:
    """The motion just after an event."""
    m = arrival
    if event == Event.NONE:
        return m
    if event == Event.TOUCH:
        return _rebound(o, m, rest_speed_m_s)
    if event == Event.HALT:
        return _moving(o, m, m.y_m, 0.0)
    phase, direction = Phase.FLIGHT, 0.0
    if o.is_dry:
        direction = m.direction
        if direction > 0.0 and o.has_stop and m.y_m >= o.gap_m:
            phase = Phase.REST_ON_STOP
        elif m.phase == Phase.REST_ON_STOP and o.dry_offset_m > 0.0:
            phase = Phase.STICK
    return m._replace(v_m_s=0.0, phase=phase, direction=direction, poised=phase == Phase.FLIGHT)


@subroutine
def _rebound(o: Oscillator, m: Motion, rest_speed_m_s: float) -> Motion:
    """Newton's impact, y'⁺ = −k y'⁻. Chatter that is certain to end is ended at `rest_speed_m_s`.

    While the spring presses, bounces follow each other in geometric progression: out at a⁻ = push + μ g,
    back at a⁺ = push − μ g, so that speeds decrease by ρ = k √(a⁺/a⁻) and all remaining bounces take v (1/a⁻
    + √(a⁺/a⁻)/a⁺) / (1 − ρ). Where the push hardly changes in that time the striker is at rest by its end
    for any cutoff, and the motion after rest does not depend on when the rest began, hence not on the
    cutoff. With dry friction the turn of a bounce below a few roundings of the position counts as rest, too.
    """
    k = o.restitution
    speed = k * m.v_m_s
    push = o.stiffness_1_s2 * (o.amplitude_m * m.sin_crank - o.gap_m)
    dry = o.stiffness_1_s2 * o.dry_offset_m
    if speed > 0.0 and push > dry:
        height = RESOLVED * (abs(o.gap_m) + o.amplitude_m) if o.is_dry else 0.0
        if speed <= rest_speed_m_s or speed * speed <= 2.0 * (push + dry) * height:
            ratio = math.sqrt((push - dry) / (push + dry))
            lasting = speed * (1.0 / (push + dry) + ratio / (push - dry)) / max(1.0 - k * ratio, 1e-300)
            change = o.stiffness_1_s2 * o.amplitude_m * o.drive_rad_s + 2.0 * o.decay_1_s * push
            if change * lasting <= CERTAIN * (push - dry):
                speed = 0.0
    return _moving(o, m, o.gap_m, -speed)
