"""Location of events on the continuous extension of a step.

Every condition is a polynomial over the step: depth, velocity, crank speed, or the distance of a force at
rest from its limit. A quantity that starts at zero is first divided by s, because that zero is not an event.
"""

from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.solvers.adaptive.state_layout import Flow, Mode, Vector
from plant_sim.solvers.bernstein import Scratch, at

NONE, TOUCH, LEAVE, CLEAR, PRESS, HALT, RELEASE, CRANK_HALT, CRANK_BREAK, LIMIT, UNLIMIT = range(11)
"""Events: touch-down; end of contact; clearing a stop that released early, or pressing it again; halt;
breakaway; the same for the crank; begin and end of the voltage limit of a current loop."""


class Step(NamedTuple):
    """A computed step: its constants, its length, mode and state before it, and the motion within it."""

    flow: Flow
    mode: Mode
    h_s: float
    y: Vector
    dense: Vector
    scratch: Scratch


class Found(NamedTuple):
    """The first event of a step and its place in the step, 0 to 1."""

    event: int
    s: float


@subroutine
def earlier(found: Found, event: int, s: float) -> Found:
    """The earlier one of `found` and this event."""
    if s < found.s:
        return Found(event, s)
    return found


@subroutine
def look_within(dense: Vector, s: float, scratch: Scratch) -> None:
    """The motion within a step, into `scratch.inner`."""
    for i in range(dense.shape[0]):
        scratch.inner[i] = at(dense[i], s)


class Course(NamedTuple):
    """A step of `h_s` as it was computed: Taylor coefficients, shape (at least motion, order + 1), or slopes
    in the stages of DOP853, shape (STAGES, state)."""

    is_series: bool
    coefficients: Vector
    k: Vector
    h_s: float
    order: int


@subroutine
def steepest(course: Course, place: int) -> float:
    """A bound of a quantity's slope within a step, of either sign: Σ j |c_j| hʲ⁻¹, or twice the largest slope
    of a stage."""
    total = 0.0
    if course.is_series:
        for j in range(course.order, 0, -1):
            total = total * course.h_s + j * abs(course.coefficients[place, j])
        return total
    for stage in range(12):
        total = max(total, abs(course.k[stage, place]))
    return 2.0 * total
