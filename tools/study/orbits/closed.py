"""Orbits in closed form: an ideal drive, viscous or Coulomb friction and a rigid stop."""

import math
from typing import NamedTuple

import numpy as np

from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import constant_speed_rad_s
from plant_sim.parts.parts import Parts
from plant_sim.result import Phase
from plant_sim.solvers.bernstein import Scratch, new_scratch, scratch_arrays
from plant_sim.solvers.double_double import TURN_RAD
from plant_sim.solvers.exact.automaton import Event, Motion, after, begin, next_event
from plant_sim.solvers.exact.ledger import booked, empty_ledger
from plant_sim.solvers.exact.oscillator import Flight, Oscillator, flow, launch, oscillator, oscillator_at
from tools.study.orbits import sections
from tools.study.orbits.sections import Period, Size

REST_SPEED_M_S = 1e-9
"""Chatter that is certain to end at rest ends below this speed; the later motion does not depend on the
value."""

MOST_EVENTS = 10_000
"""Most events in one drive period; a period with more is not followed to its end, and the orbit is
uncertain."""

LOOKS = 16
"""Samples per drive period for the turning points of a flight."""

MOST_CUTS = 40


class Closed(NamedTuple):
    """Carrier of a scene with a closed form."""

    size: Size
    oscillator: Oscillator
    scratch: Scratch


def closed(parts: Parts) -> Closed:
    """The carrier of a scene with an ideal drive, viscous or Coulomb friction and no or a rigid stop."""
    records = kernel_parts(parts)
    o = entry_point(oscillator, records)(records)
    length_m = abs(o.gap_m) + abs(o.amplitude_m)
    size = Size(o.drive_rad_s, parts.striker.rest_length_m, length_m, o.natural_rad_s * length_m)
    return Closed(size, o, scratch_arrays(0))


def ramp(parts: Parts, crank_rad: float, duration_s: float, steps: int) -> tuple[float, float, float]:
    """`ramp_closed` of these parts."""
    arguments = kernel_parts(parts), crank_rad, duration_s, steps
    return entry_point(ramp_closed, *arguments)(*arguments)


@jit
def ramp_closed(parts: Parts, crank_rad: float, duration_s: float, steps: int) -> tuple[float, float, float]:
    """y, v and crank angle after a run-up from rest at a relaxed spring to the drive's speed.

    The speed rises as an S, 3 u² − 2 u³, in steps short enough for the crank to turn little in one.
    """
    y, v, crank = 0.0, 0.0, crank_rad
    step_s = duration_s / steps
    rows, scratch = np.zeros(1, sections.PERIOD), new_scratch(0)
    for step in range(steps):
        u = (step + 0.5) / steps
        o = oscillator_at(parts, constant_speed_rad_s(parts.drive) * u * u * (3.0 - 2.0 * u))
        motion, _ = _period(o, begin(o, 0.0, y, v, crank), step_s, False, rows[0], scratch)
        y, v, crank = motion.y_m, motion.v_m_s, motion.crank_rad
    return y, v, crank


@sections.set_out.register(Closed)
def _closed_set_out(carrier: Closed, y_m: float, v_m_s: float, crank_rad: float) -> Motion:
    return begin(carrier.oscillator, 0.0, y_m, v_m_s, crank_rad)


@sections.section.register(Closed)
def _closed_section(carrier: Closed, motion: Motion) -> tuple[float, float, float, float]:
    return motion.y_m, motion.v_m_s, motion.crank_rad, motion.t_s


@sections.ends_clear.register(Closed)
def _closed_ends_clear(carrier: Closed, motion: Motion, row: Period) -> bool:
    o = carrier.oscillator
    if o.is_dry or not _stays_clear(o, motion):
        return False
    _steady_period(o, row)
    return True


@sections.carry.register(Closed)
def _closed_carry(
    carrier: Closed, motion: Motion, until_s: float, looked_at: bool, row: Period
) -> tuple[Motion, bool]:
    return _period(carrier.oscillator, motion, until_s, looked_at, row, carrier.scratch)


@subroutine
def _period(
    o: Oscillator, motion: Motion, until_s: float, looked_at: bool, row: Period, scratch: Scratch
) -> tuple[Motion, bool]:
    """Advance the motion to `until_s` and fill the row; also whether there were too many events."""
    sections.clear(row)
    ledger = empty_ledger()
    low, high, slid_m = motion.y_m, motion.y_m, 0.0
    event, events = Event.IMPACT, 0
    while event != Event.HORIZON and events < MOST_EVENTS:
        arrival, event = next_event(o, motion, until_s, scratch)
        departure = after(o, arrival, event, REST_SPEED_M_S)
        low, high = min(low, arrival.y_m), max(high, arrival.y_m)
        if motion.phase != Phase.FLIGHT:
            if motion.y_m >= o.gap_m and arrival.t_s > motion.t_s:
                row.rested = True
        else:
            slid_m += abs(arrival.y_m - motion.y_m)
            row.moved = slid_m > sections.STUCK_M or not o.is_dry
        if looked_at:
            ledger = booked(o, ledger, motion, arrival, departure)
            if not o.is_dry and motion.phase == Phase.FLIGHT:
                turns_low, turns_high = turning_points(o, motion, arrival)
                low, high = min(low, turns_low), max(high, turns_high)
        if event == Event.IMPACT:
            impulse = o.mass_kg * (arrival.v_m_s - departure.v_m_s)
            sections.count_impact(row, arrival.v_m_s, impulse, arrival.crank_rad, math.nan)
        motion = departure
        events += 1
    row.y_end_m, row.v_end_m_s = motion.y_m, motion.v_m_s
    row.y_low_m, row.y_high_m = low, high
    row.drive_j = ledger.drive_j + ledger.drive_low_j
    row.friction_j = ledger.friction_j + ledger.friction_low_j
    row.loss_j = ledger.impact_j + ledger.impact_low_j
    return motion, event != Event.HORIZON


@subroutine
def _steady_period(o: Oscillator, row: Period) -> None:
    """The row of a period of steady motion without impacts; drive and viscous friction exchange π b Ω Y²."""
    sections.clear(row)
    row.moved = True
    row.y_low_m, row.y_high_m = -o.steady_m, o.steady_m
    work = math.pi * 2.0 * o.decay_1_s * o.mass_kg * o.drive_rad_s * o.steady_m * o.steady_m
    row.drive_j, row.friction_j = work, work


@subroutine
def _stays_clear(o: Oscillator, motion: Motion) -> bool:
    """Whether a striker without dry friction provably never reaches the stop again.

    The envelope of the free part decreases, so that steady amplitude plus envelope bound the future motion.
    """
    room = o.gap_m - o.steady_m
    if o.resonant or room <= 0.0 or not o.ringing_rad_s > 0.1 * o.natural_rad_s:
        return False
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
    rate = (flight.free_m_s + o.decay_1_s * flight.free_m) / o.ringing_rad_s
    return math.hypot(flight.free_m, rate) < room * (1.0 - 1e-9)


@subroutine
def turning_points(o: Oscillator, motion: Motion, arrival: Motion) -> tuple[float, float]:
    """Lowest and highest y at which the speed of a flight passes through zero; ∞, −∞ if it does not."""
    low, high = math.inf, -math.inf
    h = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
    looks = math.ceil(h * max(o.drive_rad_s, o.natural_rad_s) * LOOKS / TURN_RAD)
    left, v_left = 0.0, motion.v_m_s
    for look in range(1, looks + 1):
        right = h * look / looks
        _, v_right, _, _ = flow(o, flight, right)
        if v_left * v_right < 0.0:
            y = _at_zero_speed(o, flight, left, v_left, right, v_right)
            low, high = min(low, y), max(high, y)
        left, v_left = right, v_right
    return low, min(high, o.gap_m)


@subroutine
def _at_zero_speed(
    o: Oscillator, flight: Flight, left: float, v_left: float, right: float, v_right: float
) -> float:
    """y where the speed passes through zero between two times of a flight (regula falsi, Illinois)."""
    y = 0.0
    for _ in range(MOST_CUTS):
        cut = right - v_right * (right - left) / (v_right - v_left)
        y, v, _, _ = flow(o, flight, cut)
        if abs(v) < 1e-9 * (abs(v_left) + abs(v_right)):
            break
        if v * v_right < 0.0:
            left, v_left = right, v_right
        else:
            v_left *= 0.5
        right, v_right = cut, v
    return y
