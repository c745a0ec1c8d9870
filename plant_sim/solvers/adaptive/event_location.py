"""Location of events on the continuous extension of a step.

Every condition is a polynomial over the step: depth, velocity, crank speed, or the distance of a force at
rest from its limit. A quantity that starts at zero is first divided by s, because that zero is not an event.
"""

from typing import NamedTuple, TypeAlias

from plant_sim.kernels import by_part, subroutine
from plant_sim.solvers.adaptive.state_layout import Flow, Vector
from plant_sim.solvers.bernstein import Scratch, at

NONE, TOUCH, LEAVE, CLEAR, PRESS, HALT, RELEASE, CRANK_HALT, CRANK_BREAK, LIMIT, UNLIMIT = range(11)
"""Events: touch-down; end of contact; clearing a stop that released early, or pressing it again; halt;
breakaway; the same for the crank; begin and end of the voltage limit of a current loop."""


class Zeros(NamedTuple):
    """Number of leading derivatives, the value included, that are zero at the step's start."""

    depth: int
    velocity: int
    crank: int
    voltage: int


class Step(NamedTuple):
    """A computed step: its constants, its length, the state before it and the motion within it."""

    flow: Flow
    zeros: Zeros
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


class Stages(NamedTuple):
    """Slopes in the stages of a step of DOP853, shape (STAGES, state)."""

    k: Vector


class Series(NamedTuple):
    """Taylor coefficients of a step, shape (at least motion, order + 1), its length and order."""

    coefficients: Vector
    h_s: float
    order: int


Course: TypeAlias = Stages | Series


@by_part
def steepest(course: Course, place: int) -> float:
    """A bound of a quantity's slope within a step, of either sign."""
    raise NotImplementedError


@steepest.register(Stages)
def _stages_steepest(course: Stages, place: int) -> float:
    """Twice the largest slope of a stage."""
    largest = 0.0
    for stage in range(12):
        largest = max(largest, abs(course.k[stage, place]))
    return 2.0 * largest


@steepest.register(Series)
def _series_steepest(course: Series, place: int) -> float:
    """Σ k |c_k| hᵏ⁻¹."""
    total = 0.0
    for k in range(course.order, 0, -1):
        total = total * course.h_s + k * abs(course.coefficients[place, k])
    return total
