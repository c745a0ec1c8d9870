"""Orbits in closed form: an ideal drive, viscous or Coulomb friction and a rigid stop."""

import math
from typing import NamedTuple

import numpy as np

from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import constant_speed_rad_s
from plant_sim.parts.parts import Parts
from plant_sim.result import Phase
from plant_sim.solvers.bernstein import Scratch, scratch_arrays
from plant_sim.solvers.exact.automaton import Event, Motion, after, begin, next_event, quiet_from_s
from plant_sim.solvers.exact.ledger import booked, empty_ledger
from plant_sim.solvers.exact.oscillator import Oscillator, launch, oscillator, oscillator_at
from tools.study.orbits import sections
from tools.study.orbits.sections import Period, Size

REST_SPEED_M_S = 1e-9
"""Chatter that is certain to end at rest ends below this speed; the later motion does not depend on the
value."""

MOST_EVENTS = 10_000
"""Most events in one drive period; a period with more is not followed to its end, and the orbit is
uncertain."""


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
    arguments = closed(parts), kernel_parts(parts), crank_rad, duration_s, steps
    return entry_point(ramp_closed, *arguments)(*arguments)


@jit
def ramp_closed(
    carrier: Closed, parts: Parts, crank_rad: float, duration_s: float, steps: int
) -> tuple[float, float, float]:
    """y, v and crank angle after a run-up from rest at a relaxed spring to the drive's speed.

    The speed rises as an S, 3 u² − 2 u³, in steps short enough for the crank to turn little in one.
    """
    y, v, crank = 0.0, 0.0, crank_rad
    step_s = duration_s / steps
    rows = np.zeros(1, sections.PERIOD)
    for step in range(steps):
        u = (step + 0.5) / steps
        o = oscillator_at(parts, constant_speed_rad_s(parts.drive) * u * u * (3.0 - 2.0 * u))
        turning = Closed(carrier.size, o, carrier.scratch)
        motion, _ = sections.carry(turning, begin(o, 0.0, y, v, crank), step_s, False, rows[0])
        y, v, crank = motion.y_m, motion.v_m_s, motion.crank_rad
    return y, v, crank


@sections.set_out.register(Closed)
def _closed_set_out(carrier: Closed, y_m: float, v_m_s: float, crank_rad: float) -> Motion:
    return begin(carrier.oscillator, 0.0, y_m, v_m_s, crank_rad)


@sections.section.register(Closed)
def _closed_section(carrier: Closed, motion: Motion) -> tuple[float, float, float]:
    return motion.y_m, motion.v_m_s, motion.crank_rad


@sections.ends_clear.register(Closed)
def _closed_ends_clear(carrier: Closed, motion: Motion, row: Period) -> bool:
    o = carrier.oscillator
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
    if o.is_dry or quiet_from_s(o, flight) > 0.0:
        return False
    _steady_period(o, row)
    return True


@sections.carry.register(Closed)
def _closed_carry(
    carrier: Closed, motion: Motion, until_s: float, looked_at: bool, row: Period
) -> tuple[Motion, bool]:
    """Too many events count as a failure."""
    o, scratch = carrier.oscillator, carrier.scratch
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
                turns_low, turns_high = turning_points(o, motion, arrival, scratch)
                low, high = min(low, turns_low), max(high, turns_high)
        if event == Event.IMPACT:
            impulse = o.mass_kg * (arrival.v_m_s - departure.v_m_s)
            sections.count_impact(row, arrival.v_m_s, impulse, math.nan)
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
def turning_points(o: Oscillator, motion: Motion, arrival: Motion, scratch: Scratch) -> tuple[float, float]:
    """Lowest and highest y at which the speed of a flight passes through zero; ∞, −∞ if it does not.

    Without dry friction a turn is no event, so it is looked for as a turn of dry friction without a force.
    """
    dry = o._replace(is_dry=True, has_stop=False)
    low, high = math.inf, -math.inf
    span_s = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
    begun = begin(dry, 0.0, motion.y_m, motion.v_m_s, motion.crank_rad)
    turn, event = next_event(dry, begun, span_s, scratch)
    while event == Event.TURN:
        low, high = min(low, turn.y_m), max(high, turn.y_m)
        turn, event = next_event(dry, after(dry, turn, event, 0.0), span_s, scratch)
    return low, min(high, o.gap_m)
