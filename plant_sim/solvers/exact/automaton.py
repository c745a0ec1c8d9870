"""The striker as a hybrid automaton: flow until the next event, apply its transition, repeat.

    FLIGHT        closed-form motion; leaves by IMPACT, or with dry friction by TURN (the speed reaches zero)
    STICK         dry friction holds; leaves by RELEASE_UP or RELEASE_DOWN when the spring overcomes it
    REST_ON_STOP  pressed on the stop; leaves by RELEASE_DOWN when the spring pulls it off

            IMPACT: rebound            TURN: |push| ≤ μ m g            RELEASE_UP on the stop
    FLIGHT ───────────────▶ FLIGHT   FLIGHT ─────────────▶ STICK   STICK ───────────────▶ REST_ON_STOP
           ───────────────▶ REST_ON_STOP    ◀───────────── STICK         ◀─────────────── REST_ON_STOP
            plastic or end of chatter       RELEASE_UP, RELEASE_DOWN          RELEASE_DOWN with dry friction
    FLIGHT ◀─────────────── REST_ON_STOP: RELEASE_DOWN without dry friction

A striker that sticks has no speed and therefore cannot meet the stop. Every function here is pure and
compiled, so that studies can run this loop inside kernels of their own:

    motion = begin(o, t_s, x − l0, v, crank)
    while True:
        arrival, event = next_event(o, motion, until_s)
        …a study's evaluation of `motion`, `arrival` and `event`…
        if event == Event.HORIZON: break
        motion = after(o, arrival, event, rest_speed_m_s)
"""

import math
from enum import IntEnum
from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.parts.friction import ROUNDING as HELD_ROUNDING
from plant_sim.parts.friction import is_dry
from plant_sim.parts.stop import has_stop
from plant_sim.result import Phase
from plant_sim.solvers.double_double import TURN_RAD, add, turned
from plant_sim.solvers.exact.crossing import Crossing, clear_up_to, cross_cells, sets_off
from plant_sim.solvers.exact.oscillator import (
    Flight,
    Oscillator,
    Point,
    flow,
    launch,
    point,
)
from plant_sim.solvers.exact.roots import clear_span, polish

SETTLED = 5e-2  # spans below this over the fastest rate leave a Taylor polynomial exact to rounding
SCAN_SPAN = 2.0  # the derivatives' bound is taken over this many over ω
CERTAIN = 1e-3  # share of the pressing acceleration that may change until chatter is over
RESOLVED = 4e-15  # least height of a bounce over the position's scale: some roundings
SMALL = 1e-2
ROUNDING = 2.3e-16
LEAST_SPEED_M_S = 1e-100
HALF_PI = 0.5 * math.pi


class Event(IntEnum):
    """The event that ends a flow."""

    HORIZON = 0
    IMPACT = 1
    TURN = 2
    RELEASE_UP = 3
    RELEASE_DOWN = 4


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
    direction: float  # of sliding with dry friction: ±1; 0 otherwise
    poised: bool  # just released: the net force is exactly zero


@subroutine
def begin(o: Oscillator, t_s: float, y_m: float, v_m_s: float, crank_rad: float) -> Motion:
    """The motion from a state at or before the stop."""
    crank, crank_low = turned(crank_rad, 0.0, 0.0, 0.0, 0.0)
    return _moving(o, t_s, 0.0, crank, crank_low, math.sin(crank), math.cos(crank), y_m, v_m_s)


@subroutine
def _moving(
    o: Oscillator,
    t: float,
    t_low: float,
    crank: float,
    crank_low: float,
    sin_crank: float,
    cos_crank: float,
    y: float,
    v: float,
) -> Motion:
    """The motion from a state: its phase follows from speed, place and force."""
    if abs(v) < LEAST_SPEED_M_S:
        v = 0.0  # its square would vanish
    phase, direction, poised = Phase.FLIGHT, 0.0, False
    push = o.amplitude_m * sin_crank - y  # spring force over c
    held = o.dry_offset_m
    if v != 0.0:
        if is_dry(o.friction):
            direction = math.copysign(1.0, v)
    elif is_dry(o.friction) and held > 0.0 and abs(push) <= held + _doubt_m(o, y):
        phase = Phase.STICK
    elif (
        has_stop(o.stop) and y >= o.gap_m and (push > held or (push >= -_doubt_m(o, y) and cos_crank >= 0.0))
    ):
        phase = Phase.REST_ON_STOP
    else:
        poised = push == 0.0 and has_stop(o.stop) and y >= o.gap_m
        if is_dry(o.friction):
            direction = math.copysign(1.0, push)
    return Motion(t, t_low, crank, crank_low, sin_crank, cos_crank, y, v, phase, direction, poised)


@subroutine
def _doubt_m(o: Oscillator, y: float) -> float:
    """The rounding error of a force on a striker at rest, which does not set it in motion."""
    return HELD_ROUNDING * (o.amplitude_m + abs(y) + o.dry_offset_m)


@subroutine
def next_event(o: Oscillator, motion: Motion, until_s: float) -> tuple[Motion, Event]:
    """The motion just before the first event up to `until_s`, and that event."""
    if motion.phase == Phase.FLIGHT:
        return _fly(o, motion, until_s)
    return _wait(o, motion, until_s)


@subroutine
def _arrive(o: Oscillator, motion: Motion, duration: float, y: float, v: float) -> Motion:
    t, t_low = add(motion.t_s, motion.t_low_s, duration)
    crank, crank_low = turned(motion.crank_rad, motion.crank_low_rad, o.drive_rad_s, 0.0, duration)
    return Motion(
        t,
        t_low,
        crank,
        crank_low,
        math.sin(crank),
        math.cos(crank),
        y,
        v,
        motion.phase,
        motion.direction,
        False,
    )


@subroutine
def _at_horizon(o: Oscillator, motion: Motion, until_s: float, y: float, v: float) -> Motion:
    span = (until_s - motion.t_s) - motion.t_low_s
    there = _arrive(o, motion, span, y, v)
    return Motion(
        until_s,
        0.0,
        there.crank_rad,
        there.crank_low_rad,
        there.sin_crank,
        there.cos_crank,
        y,
        v,
        motion.phase,
        motion.direction,
        motion.poised and span <= 0.0,
    )


@subroutine
def _wait(o: Oscillator, motion: Motion, until_s: float) -> tuple[Motion, Event]:
    """Stick or rest until the spring's force crosses what holds the striker: A sin θ = y ± μ m g / c."""
    A, y, held = o.amplitude_m, motion.y_m, o.dry_offset_m
    turning = A - _doubt_m(
        o, y
    )  # a push that passes the limit by less, where the piston turns round, is held
    rising = motion.crank_rad >= -HALF_PI and motion.cos_crank >= 0.0
    crank = motion.crank_rad if motion.crank_rad >= -HALF_PI else motion.crank_rad + TURN_RAD
    turn_up, turn_down = math.inf, math.inf
    if motion.phase == Phase.REST_ON_STOP:
        level = y + held
        if level > -turning:
            turn_down = max(0.0, ((math.pi - _level_angle(level, A)) - crank) - motion.crank_low_rad)
    else:
        if y + held < turning:
            angle = _level_angle(y + held, A)
            if not rising:
                angle += TURN_RAD
            turn_up = max(0.0, (angle - crank) - motion.crank_low_rad)
        if y - held > -turning:
            turn_down = max(0.0, ((math.pi - _level_angle(y - held, A)) - crank) - motion.crank_low_rad)
    turn = min(turn_up, turn_down)
    if turn < math.inf and o.drive_rad_s > 0.0:
        arrival = _arrive(o, motion, turn / o.drive_rad_s, y, 0.0)
        if arrival.t_s <= until_s:
            return arrival, Event.RELEASE_UP if turn_up < turn_down else Event.RELEASE_DOWN
    return _at_horizon(o, motion, until_s, y, 0.0), Event.HORIZON


@subroutine
def _level_angle(level: float, amplitude: float) -> float:
    """asin(level / amplitude), accurate near ±π/2 and clipped beyond."""
    return math.atan2(level, math.sqrt(max(0.0, (amplitude - level) * (amplitude + level))))


@subroutine
def _derivative_bounds(o: Oscillator, p: Point, span: float) -> tuple[float, float, float]:
    """Bounds on the fourth, fifth and sixth derivative of y over a span from a point.

    The free energy norm √(ω² y² + y'²) grows by at most the force per mass; each further derivative is
    bounded by the equation of motion, or where damping is strong by z' = −2σ z + f ⇒ |z| ≤ max(|z0|, max|f|
    / 2σ).
    """
    w, w2, drag, Omega = o.natural_rad_s, o.stiffness_1_s2, 2.0 * o.decay_1_s, o.drive_rad_s
    drive = w2 * o.amplitude_m
    drive_1, drive_2 = drive * Omega, drive * Omega * Omega
    force = drive + w2 * o.dry_offset_m
    b1 = math.sqrt(w2 * p.y_m * p.y_m + p.v_m_s * p.v_m_s) + force * span
    b2 = w * b1 + force
    if drag <= 0.5 * w:
        b2 += drag * b1
        b3 = drag * b2 + w2 * b1 + drive_1
        b4 = drag * b3 + w2 * b2 + drive_2
    else:
        b1 = min(b1, max(abs(p.v_m_s), b2 / drag))
        b2 = min(b2 + drag * b1, max(abs(p.a_m_s2), (w2 * b1 + drive_1) / drag))
        pull = w2 * b1 + drive_1
        b3 = min(drag * b2 + pull, max(abs(p.jerk_m_s3), (w2 * b2 + drive_2) / drag))
        pull = w2 * b2 + drive_2
        b4 = min(drag * b3 + pull, max(abs(p.snap_m_s4), (w2 * b3 + drive_2 * Omega) / drag))
    b5 = drag * b4 + w2 * b3 + drive_2 * Omega
    return b4, b5, drag * b5 + w2 * b4 + drive_2 * Omega * Omega


@subroutine
def _quiet_from(o: Oscillator, flight: Flight) -> float:
    """Time after the start of a flight without dry friction from which on it stays clear of the stop, s."""
    room = o.gap_m - o.steady_m
    if o.resonant or not room > 0.0 or not o.ringing_rad_s > 0.1 * o.natural_rad_s:
        return math.inf
    amplitude = math.hypot(flight.free_m, (flight.free_m_s + o.decay_1_s * flight.free_m) / o.ringing_rad_s)
    if amplitude < room * (1.0 - 1e-12):
        return 0.0
    return math.log(amplitude / (room * (1.0 - 1e-12))) / o.decay_1_s if o.decay_1_s > 0.0 else math.inf


@subroutine
def _fly(o: Oscillator, motion: Motion, until_s: float) -> tuple[Motion, Event]:
    """Fly to the stop or the turn: prove a span clear, advance over it, and locate the event once it is
    close.

    Cells cover most of a flight. Where their proof fails, a step by the bounds on derivatives is taken; after
    a step that is as long as a cell, cells are tried again.
    """
    direction = motion.direction
    end = (until_s - motion.t_s) - motion.t_low_s
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, direction)
    here = point(o, flight, 0.0, motion.y_m, motion.v_m_s, 0.0, 1.0)
    if motion.poised or (motion.v_m_s == 0.0 and direction * here.a_m_s2 < 0.0):
        here = _without_force(here)
    first_period = TURN_RAD / o.natural_rad_s
    last = end + ROUNDING * abs(until_s)  # an event whose time rounds to the end belongs to the run
    scan_end = last if has_stop(o.stop) or is_dry(o.friction) else -1.0
    in_cells = sets_off(o, here, direction)
    while here.h_s <= scan_end:
        if in_cells:
            crossing = cross_cells(o, flight, here, direction, last)
        else:
            crossing = _step_on(o, here, direction, last)
        if crossing.found:
            arrival = _arrive(o, motion, crossing.time_s, crossing.y_m, crossing.v_m_s)
            if arrival.t_s <= until_s:
                return arrival, Event.IMPACT if crossing.at_stop else Event.TURN
            break
        h = crossing.clear_s
        if h >= last:
            break
        if not is_dry(o.friction) and here.h_s < first_period <= h:
            scan_end = min(last, _quiet_from(o, flight))
        in_cells = not in_cells and h - here.h_s >= o.cells.span_s > 0.0
        if h > here.h_s:
            y, v, sin_drive, cos_drive = flow(o, flight, h)
            here = point(o, flight, h, y, v, sin_drive, cos_drive)
    y, v, _, _ = flow(o, flight, end)
    return _at_horizon(o, motion, until_s, min(y, o.gap_m), v), Event.HORIZON


@subroutine
def _step_on(o: Oscillator, here: Point, direction: float, last: float) -> Crossing:
    """Advance by one step from the bounds on derivatives."""
    settled = SETTLED / o.fastest_1_s
    step, event = _look_ahead(o, here, direction, min(last - here.h_s, SCAN_SPAN / o.natural_rad_s))
    if event != Event.HORIZON and step <= settled:
        rest, y, v = _settle(o, here, direction, event, step, 2.0 * settled)
        if rest >= 0.0:
            return Crossing(here.h_s, True, event == Event.IMPACT, here.h_s + rest, y, v)
        step = max(step, 1e-7 * settled)  # it touches zero within rounding: pass it
    return clear_up_to(here.h_s + step)


@subroutine
def _without_force(p: Point) -> Point:
    """A point just released, whose net force is zero: rounding must not push it back."""
    return Point(
        p.h_s, p.y_m, p.v_m_s, 0.0, p.jerk_m_s3, p.snap_m_s4, p.crackle_m_s5, p.piston_m, p.piston_cos_m
    )


@subroutine
def _look_ahead(o: Oscillator, p: Point, direction: float, span: float) -> tuple[float, Event]:
    """A span without an event, and the event that may follow it."""
    b4, b5, b6 = _derivative_bounds(o, p, span)
    step, event = span, Event.HORIZON
    if has_stop(o.stop):
        overlap = min(p.y_m - o.gap_m, 0.0)
        clear = clear_span(overlap, p.v_m_s, p.a_m_s2, p.jerk_m_s3, p.snap_m_s4, b4, b5, step)
        if clear < step:
            step, event = clear, Event.IMPACT
    if is_dry(o.friction):
        s = -direction
        clear = clear_span(
            min(s * p.v_m_s, 0.0),
            s * p.a_m_s2,
            s * p.jerk_m_s3,
            s * p.snap_m_s4,
            s * p.crackle_m_s5,
            b5,
            b6,
            step,
        )
        if clear < step:
            step, event = clear, Event.TURN
    return step, event


@subroutine
def _settle(
    o: Oscillator, p: Point, direction: float, event: Event, step: float, limit: float
) -> tuple[float, float, float]:
    """Time from a point to the event close by, −1 if it does not happen, with y and y' just before it.

    The root of a Taylor polynomial of low degree, then one step of Newton's method with all terms, which has
    to be small against the distance to the next turn: near grazing the event is left to a closer point.
    """
    y, v, a, d3, d4, d5 = p.y_m, p.v_m_s, p.a_m_s2, p.jerk_m_s3, p.snap_m_s4, p.crackle_m_s5
    back = -direction
    overlap, against = min(y - o.gap_m, 0.0), min(back * v, 0.0)
    if event == Event.IMPACT:
        s = 0.0 if overlap == 0.0 and v > 0.0 else polish(overlap, v, a, d3, d4, d5, step, limit)
    else:
        at_once = against == 0.0 and back * a > 0.0
        s = 0.0 if at_once else polish(against, back * a, back * d3, back * d4, back * d5, 0.0, step, limit)
    if s <= 0.0:
        return (s, o.gap_m, v) if event == Event.IMPACT else (s, y, 0.0)
    drag, w2, square = 2.0 * o.decay_1_s, o.stiffness_1_s2, o.drive_rad_s * o.drive_rad_s
    x4 = square * square * p.piston_m  # derivatives of x_A
    x5 = square * square * o.drive_rad_s * p.piston_cos_m
    d6 = -drag * d5 - w2 * (d4 - x4)
    d7 = -drag * d6 - w2 * (d5 - x5)
    d8 = -drag * d7 - w2 * (d6 + square * x4)
    d9 = -drag * d8 - w2 * (d7 + square * x5)
    high = d6 / 720 + s * (d7 / 5040 + s * (d8 / 40320 + s * d9 / 362880))
    high_rate = d6 / 120 + s * (d7 / 720 + s * (d8 / 5040 + s * d9 / 40320))
    rise = s * (v + s * (a / 2 + s * (d3 / 6 + s * (d4 / 24 + s * (d5 / 120 + s * high)))))
    speed = v + s * (a + s * (d3 / 2 + s * (d4 / 6 + s * (d5 / 24 + s * high_rate))))
    pull = a + s * (d3 + s * (d4 / 2 + s * d5 / 6))
    if event == Event.IMPACT:
        correction = -(overlap + rise) / speed
        if not (speed > 0.0 and abs(correction * pull) <= SMALL * speed):
            return -1.0, y, v
        return max(s + correction, 0.0), o.gap_m, speed + correction * pull
    correction = -speed / pull
    if not abs(correction * (d3 + s * (d4 + s * d5 / 2))) <= SMALL * abs(pull):
        return -1.0, y, v
    return max(s + correction, 0.0), min(y + rise, o.gap_m), 0.0


@subroutine
def after(o: Oscillator, arrival: Motion, event: Event, rest_speed_m_s: float) -> Motion:
    """The motion just after an event."""
    m = arrival
    if event == Event.HORIZON:
        return m
    if event == Event.IMPACT:
        return _rebound(o, m, rest_speed_m_s)
    if event == Event.TURN:
        return _moving(
            o, m.t_s, m.t_low_s, m.crank_rad, m.crank_low_rad, m.sin_crank, m.cos_crank, m.y_m, 0.0
        )
    phase, direction = Phase.FLIGHT, 0.0
    if is_dry(o.friction):
        direction = 1.0 if event == Event.RELEASE_UP else -1.0
        if event == Event.RELEASE_UP and has_stop(o.stop) and m.y_m >= o.gap_m:
            phase = Phase.REST_ON_STOP
        elif m.phase == Phase.REST_ON_STOP and o.dry_offset_m > 0.0:
            phase = Phase.STICK
    return Motion(
        m.t_s,
        m.t_low_s,
        m.crank_rad,
        m.crank_low_rad,
        m.sin_crank,
        m.cos_crank,
        m.y_m,
        0.0,
        phase,
        direction,
        phase == Phase.FLIGHT,
    )


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
        height = RESOLVED * (abs(o.gap_m) + o.amplitude_m) if is_dry(o.friction) else 0.0
        if speed <= rest_speed_m_s or speed * speed <= 2.0 * (push + dry) * height:
            ratio = math.sqrt((push - dry) / (push + dry))
            lasting = speed * (1.0 / (push + dry) + ratio / (push - dry)) / max(1.0 - k * ratio, 1e-300)
            change = o.stiffness_1_s2 * o.amplitude_m * o.drive_rad_s + 2.0 * o.decay_1_s * push
            if change * lasting <= CERTAIN * (push - dry):
                speed = 0.0
    return _moving(
        o, m.t_s, m.t_low_s, m.crank_rad, m.crank_low_rad, m.sin_crank, m.cos_crank, o.gap_m, -speed
    )
