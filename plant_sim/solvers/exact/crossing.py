"""The event that ends a flight: a polynomial above each guard over a span, and its first root.

The guards are the striker's overlap with the stop and, with dry friction, its speed against the direction it
slides in: both are ≤ 0 in a flight, and the first to reach zero ends it.

Over a span of length h a guard g is known with three derivatives at both ends. With Bernstein's polynomials
B₀…B₇ of s / h, Hermite's interpolant p is Σ bᵢ Bᵢ; b₀…b₃ follow from the derivatives at the start, b₄…b₇ from
those at the end, and

    |g − p| ≤ max|g⁽⁸⁾| s⁴ (h − s)⁴ / 8! ≤ E (B₃ + B₄),   E = max|g⁽⁸⁾| h⁸ / (2 · 35 · 8!),

for s⁴ (h − s)⁴ is the mean of h − s times s⁴ (h − s)³ = h⁷ B₄ / 35 and of s times s³ (h − s)⁴ = h⁷ B₃ / 35.
So p + E (B₃ + B₄) lies above g, and g has no root before it has one. Spans that end there converge to a root
from the left, and pass a near miss without a false root.
"""

import math
from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.solvers.bernstein import DEGREE, NO_ROOT, Scratch, root
from plant_sim.solvers.exact.oscillator import (
    REMAINDER,
    Flight,
    Oscillator,
    Point,
    flow,
    point,
    with_derivatives,
)

STRONG_DRAG = 0.5
"""2σ / ω from which a derivative's bound follows from its own decay."""

SHORT = 0.1  # of the fastest rate's angle: a Taylor polynomial of degree 9 is exact to rounding
CLOSE = 5e-3  # of that angle: a quartic is exact to rounding
STRAIGHT = 1e-3  # change of slope up to which a root's series is exact to rounding
NEARLY_STRAIGHT = 0.05  # change of slope up to which a guard surely has one root near
ROOT_SHARE = 1e-6  # of a span: an event near is located by Newton's method
LEAST_SPAN = 1e-8  # of the fastest rate's angle: a motion over less is within rounding
MOST_TRIES = 4


class Guard(NamedTuple):
    """A guard and its first four derivatives at one instant."""

    value: float
    slope: float
    bend: float
    third: float
    fourth: float


class Crossing(NamedTuple):
    """The time up to which a span is clear of events, over its length (NO_ROOT: all of it), and the guard's
    event that may follow: on the stop, otherwise a turn."""

    s: float
    at_stop: bool


@subroutine(inline=True)
def overlap(p: Point) -> Guard:
    """The striker's overlap with the stop, m."""
    return Guard(min(p.overlap_m, 0.0), p.v_m_s, p.a_m_s2, p.jerk_m_s3, p.snap_m_s4)


@subroutine(inline=True)
def backing(p: Point, direction: float) -> Guard:
    """The striker's speed against the direction it slides in, m/s."""
    back = -direction
    return Guard(
        min(back * p.v_m_s, 0.0),
        back * p.a_m_s2,
        back * p.jerk_m_s3,
        back * p.snap_m_s4,
        back * p.crackle_m_s5,
    )


@subroutine
def point_after(o: Oscillator, flight: Flight, here: Point, rest_s: float) -> Point:
    """The point of a flight `rest_s` after a point; over a short time by Taylor's polynomial."""
    h = here.h_s + rest_s
    if abs(rest_s) * o.fastest_1_s > SHORT:
        y, v, sin_drive, cos_drive = flow(o, flight, h)
        return point(o, flight, h, y, v, sin_drive, cos_drive)
    drag, w2, square, s = 2.0 * o.decay_1_s, o.stiffness_1_s2, o.drive_rad_s * o.drive_rad_s, rest_s
    v, a, d3, d4, d5 = here.v_m_s, here.a_m_s2, here.jerk_m_s3, here.snap_m_s4, here.crackle_m_s5
    x4 = square * square * here.piston_m  # derivatives of x_A
    x5 = square * square * o.drive_rad_s * here.piston_cos_m
    d6 = -drag * d5 - w2 * (d4 - x4)
    d7 = -drag * d6 - w2 * (d5 - x5)
    d8 = -drag * d7 - w2 * (d6 + square * x4)
    d9 = -drag * d8 - w2 * (d7 + square * x5)
    high = d6 / 720 + s * (d7 / 5040 + s * (d8 / 40320 + s * d9 / 362880))
    high_rate = d6 / 120 + s * (d7 / 720 + s * (d8 / 5040 + s * d9 / 40320))
    rise = s * (v + s * (a / 2 + s * (d3 / 6 + s * (d4 / 24 + s * (d5 / 120 + s * high)))))
    v += s * (a + s * (d3 / 2 + s * (d4 / 6 + s * (d5 / 24 + s * high_rate))))
    sine, cosine = math.sin(o.drive_rad_s * s), math.cos(o.drive_rad_s * s)
    x_A = here.piston_m * cosine + here.piston_cos_m * sine
    x_cos = here.piston_cos_m * cosine - here.piston_m * sine
    return with_derivatives(o, flight.offset_m, h, here.y_m + rise, here.overlap_m + rise, v, x_A, x_cos)


@subroutine(inline=True)
def high_derivative_bounds(o: Oscillator, p: Point, span: float) -> tuple[float, float]:
    """Bounds on the eighth and the ninth derivative of y over a span from a point.

    The free energy norm √(ω² y² + y'²) grows by at most the force per mass; each further derivative z is
    bounded by the equation of motion, or where damping is strong by z' = −2σ z + f ⇒ |z| ≤ max(|z0|, max|f|
    / 2σ).
    """
    w, w2, drag, Omega = o.natural_rad_s, o.stiffness_1_s2, 2.0 * o.decay_1_s, o.drive_rad_s
    is_strong = drag > STRONG_DRAG * w
    drive = w2 * o.amplitude_m
    force = drive + w2 * o.dry_offset_m
    low = math.sqrt(w2 * p.y_m * p.y_m + p.v_m_s * p.v_m_s) + force * span
    pull = w * low + force
    rate = drive * Omega
    if is_strong:
        low = min(low, max(abs(p.v_m_s), pull / drag))
    high = drag * low + pull
    if is_strong:
        high = min(high, max(abs(p.a_m_s2), (w2 * low + rate) / drag))
    before, here, piston, after = p.v_m_s, p.a_m_s2, Omega * p.piston_cos_m, -Omega * Omega * p.piston_m
    for _ in range(3, 10):
        low, high, pull = high, drag * high + w2 * low + rate, w2 * high
        rate *= Omega
        if is_strong:
            before, here = here, -drag * here - w2 * (before - piston)
            piston, after = after, -Omega * Omega * piston
            high = min(high, max(abs(here), (pull + rate) / drag))
    return low, high


@subroutine
def first_crossing(o: Oscillator, here: Point, there: Point, direction: float, scratch: Scratch) -> Crossing:
    """Where an event may occur first between two points of a flight; before, there is none."""
    span = there.h_s - here.h_s
    square = span * span
    share = REMAINDER * square * square * square * square
    eighth, ninth = high_derivative_bounds(o, here, span)
    first, at_stop = NO_ROOT, False
    if o.has_stop:
        end = overlap(there)._replace(value=there.overlap_m)  # beyond the stop, where it may be by then
        first = _first_root(overlap(here), end, span, share * eighth, scratch)
        at_stop = first <= 1.0
    if o.is_dry:
        end = backing(there, direction)._replace(value=-direction * there.v_m_s)
        turn = _first_root(backing(here, direction), end, span, share * ninth, scratch)
        if turn < first:
            first, at_stop = turn, False
    return Crossing(first, at_stop)


@subroutine(inline=True)
def _first_root(start: Guard, end: Guard, span: float, error: float, scratch: Scratch) -> float:
    """First s at which the polynomial above a guard reaches zero after its start; `error` is E."""
    step, bend, third = span / 7.0, span * span / 42.0, span * span * span / 210.0
    b1 = start.value + step * start.slope
    b2 = b1 + (step * start.slope + bend * start.bend)
    b3 = b2 + (step * start.slope + 2.0 * bend * start.bend) + third * start.third + error
    b6 = end.value - step * end.slope
    b5 = b6 - (step * end.slope - bend * end.bend)
    b4 = b5 - (step * end.slope - 2.0 * bend * end.bend) - third * end.third + error
    if max(b1, b2, b3) < 0.0 and max(b4, b5, b6, end.value) < 0.0:
        return NO_ROOT
    b = scratch.press[: DEGREE + 1]
    b[0], b[1], b[2], b[3] = start.value, b1, b2, b3
    b[4], b[5], b[6], b[7] = b4, b5, b6, end.value
    zeros = 0
    if start.value == 0.0:
        zeros = 1
        if start.slope == 0.0:
            zeros = 3 if start.bend == 0.0 else 2
    return root(b, 1.0, 0.0, zeros, scratch, ROOT_SHARE)


@subroutine
def event_near(
    o: Oscillator, flight: Flight, near: Point, direction: float, at_stop: bool
) -> tuple[bool, Point]:
    """Whether a guard, clear up to a point, surely has a root near it; and the point of the event."""
    p = near
    for _ in range(MOST_TRIES):
        guard = overlap(p)._replace(value=p.overlap_m)
        if not at_stop:
            guard = backing(p, direction)._replace(value=-direction * p.v_m_s)
        if not guard.slope > 0.0:
            break
        rest = -guard.value / guard.slope
        if abs(rest) * o.fastest_1_s > SHORT or abs(guard.bend * rest) > NEARLY_STRAIGHT * guard.slope:
            break
        is_last = abs(rest) * o.fastest_1_s <= CLOSE and abs(guard.bend * rest) <= STRAIGHT * guard.slope
        p = point_after(o, flight, p, near_root(guard))
        if is_last:
            return True, p
    return False, near


@subroutine
def near_root(guard: Guard) -> float:
    """Distance to a close root of a nearly linear Taylor polynomial.

    The reversed series (Abramowitz & Stegun 3.6.25) in r = −g / slope; for |bend r| ≤ slope / 1000 its
    remainder is below 1e-12 of r.
    """
    per_slope = 1.0 / guard.slope
    r = -guard.value * per_slope
    b, c, d = guard.bend / 2 * per_slope, guard.third / 6 * per_slope, guard.fourth / 24 * per_slope
    return r + r * r * (-b + r * ((2.0 * b * b - c) + r * (5.0 * b * (c - b * b) - d)))


@subroutine
def return_s(guard: Guard) -> float:
    """Time until a guard returns to zero as its parabola does, s; ∞ if it does not."""
    discriminant = guard.slope * guard.slope - 2.0 * guard.bend * guard.value
    if guard.bend <= 0.0 or discriminant < 0.0:
        return math.inf
    return (math.sqrt(discriminant) - guard.slope) / guard.bend
