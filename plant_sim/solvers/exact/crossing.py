"""A flight in cells: the time up to which it is clear of stop and turn, and the event that ends it.

The guards are the striker's overlap with the stop and, with dry friction, its speed against the direction it
slides in: both are ≤ 0 in a flight, and the first to reach zero ends it.
"""

from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.parts.friction import is_dry
from plant_sim.parts.stop import has_stop
from plant_sim.solvers.exact.cells import Doubt, Place, bends_below, doubt, onward
from plant_sim.solvers.exact.oscillator import Flight, Oscillator, Point, flow, point
from plant_sim.solvers.exact.roots import guess_between, near_root

MOST_CELLS = 32  # until rounding is shaken off by the closed form
MOST_TRIES = 4
CLOSE = 5e-3  # of the fastest rate's angle: a quartic is then exact to rounding
STRAIGHT = 1e-3  # change of slope up to which a root's series is exact to rounding


class Crossing(NamedTuple):
    """Time up to which a flight is clear, and the event at its end if one is found: on the stop, otherwise a
    turn."""

    clear_s: float
    found: bool
    at_stop: bool
    time_s: float  # of the event; then y and y' just before it
    y_m: float
    v_m_s: float


class Cell(NamedTuple):
    """A cell that begins `start_s` after the start of its flight."""

    start_s: float
    left: Place
    right: Place
    doubts: Doubt


@subroutine
def clear_up_to(clear_s: float) -> Crossing:
    """No event found."""
    return Crossing(clear_s, False, False, 0.0, 0.0, 0.0)


@subroutine
def sets_off(o: Oscillator, here: Point, direction: float) -> bool:
    """Whether a flight leaves stop and turn behind fast enough for its first cell to be clear."""
    third = o.cells.span_s / 3.0
    doubts = doubt(o.cells, here.y_m, here.v_m_s, o.natural_rad_s)
    leaves = third > 0.0
    if has_stop(o.stop):
        leaves = leaves and here.y_m - o.gap_m + third * here.v_m_s < -doubts.place_m
    if is_dry(o.friction):
        slow = -direction * (here.v_m_s + third * here.a_m_s2)
        leaves = leaves and (slow < -doubts.speed_m_s or here.v_m_s == here.a_m_s2 == 0.0)
    return leaves


@subroutine
def cross_cells(o: Oscillator, flight: Flight, here: Point, direction: float, last_s: float) -> Crossing:
    """Advance from cell to cell while they are clear, and find the event in the first that is not."""
    span = o.cells.span_s
    left = Place(here.y_m - flight.offset_m, here.v_m_s, here.a_m_s2, here.piston_m, here.piston_cos_m)
    for index in range(MOST_CELLS):
        start_s = here.h_s + index * span
        if start_s >= last_s:
            return clear_up_to(start_s)
        cell = Cell(
            start_s, left, onward(o.cells, left), doubt(o.cells, left.z_m, left.v_m_s, o.natural_rad_s)
        )
        if not _is_clear(o, flight, cell, direction):
            return _event_within(o, flight, cell, direction)
        left = cell.right
    return clear_up_to(here.h_s + MOST_CELLS * span)


@subroutine
def _is_clear(o: Oscillator, flight: Flight, cell: Cell, direction: float) -> bool:
    """Whether neither guard, ≤ 0 at the cell's start, has a root in it."""
    left, right, doubts, span = cell.left, cell.right, cell.doubts, o.cells.span_s
    clear = True
    if has_stop(o.stop):
        gap, slack = o.gap_m - flight.offset_m, doubts.place_m + doubts.blur_m
        end = right.z_m - gap
        clear = end < -slack and bends_below(left.z_m - gap, left.v_m_s, end, right.v_m_s, span, slack)
    if is_dry(o.friction):
        s, slack = -direction, doubts.speed_m_s + doubts.blur_m_s
        end = s * right.v_m_s
        clear = clear and end < -slack
        clear = clear and bends_below(s * left.v_m_s, s * left.a_m_s2, end, s * right.a_m_s2, span, slack)
    return clear


@subroutine
def _event_within(o: Oscillator, flight: Flight, cell: Cell, direction: float) -> Crossing:
    """The event in a cell: a root that Newton's method finds and up to which the cell is proved clear.

    No event is returned where the guard passes zero twice or grazes it; finer methods then decide.
    """
    s, span, gap = -direction, o.cells.span_s, o.gap_m - flight.offset_m
    left, right, nothing = cell.left, cell.right, clear_up_to(cell.start_s)
    at_stop = has_stop(o.stop) and right.z_m > gap
    if at_stop:
        time = guess_between(left.z_m - gap, left.v_m_s, right.z_m - gap, right.v_m_s, span)
    elif is_dry(o.friction) and s * right.v_m_s > 0.0:
        time = guess_between(s * left.v_m_s, s * left.a_m_s2, s * right.v_m_s, s * right.a_m_s2, span)
    else:
        return nothing
    for _ in range(MOST_TRIES):
        h = cell.start_s + time
        y, v, sin_drive, cos_drive = flow(o, flight, h)
        p = point(o, flight, h, y, v, sin_drive, cos_drive)
        if at_stop:
            g, slope, bend, third, fourth = y - o.gap_m, v, p.a_m_s2, p.jerk_m_s3, p.snap_m_s4
        else:
            g, slope, bend = s * v, s * p.a_m_s2, s * p.jerk_m_s3
            third, fourth = s * p.snap_m_s4, s * p.crackle_m_s5
        if not slope > 0.0:
            return nothing
        rest = -g / slope
        if abs(rest) <= CLOSE / o.fastest_1_s and abs(bend * rest) <= STRAIGHT * slope:
            rest = near_root(g, slope, bend, third, fourth)
            return _proved(o, flight, cell, direction, p, rest, at_stop)
        time = min(max(time + rest, 0.0), span)
    return nothing


@subroutine
def _proved(
    o: Oscillator, flight: Flight, cell: Cell, direction: float, p: Point, rest: float, at_stop: bool
) -> Crossing:
    """The event `rest` seconds from a point close by, if its cell is clear of both guards up to it."""
    v, a, jerk, snap, crackle = p.v_m_s, p.a_m_s2, p.jerk_m_s3, p.snap_m_s4, p.crackle_m_s5
    y = p.y_m + rest * (v + rest * (a / 2 + rest * (jerk / 6 + rest * (snap / 24 + rest * crackle / 120))))
    v = v + rest * (a + rest * (jerk / 2 + rest * (snap / 6 + rest * crackle / 24)))
    a = a + rest * (jerk + rest * (snap / 2 + rest * crackle / 6))
    y, v = (o.gap_m, v) if at_stop else (y, 0.0)

    left, doubts, time = cell.left, cell.doubts, p.h_s + rest
    span = time - cell.start_s
    share = (span / o.cells.span_s) ** 4  # of the cell's E
    clear = 0.0 < span <= o.cells.span_s
    if has_stop(o.stop):
        start, end, slack = left.z_m - (o.gap_m - flight.offset_m), y - o.gap_m, doubts.blur_m
        clear = clear and (at_stop or end < -slack)
        clear = clear and bends_below(start, left.v_m_s, end, v, span, slack + share * doubts.place_m)
    if is_dry(o.friction):
        s, slack = -direction, doubts.blur_m_s
        clear = clear and (not at_stop or s * v < -slack)
        clear = clear and bends_below(
            s * left.v_m_s, s * left.a_m_s2, s * v, s * a, span, slack + share * doubts.speed_m_s
        )
    return Crossing(cell.start_s, True, at_stop, time, y, v) if clear else clear_up_to(cell.start_s)
