"""Location of events on the continuous extension of a step.

Every condition is a polynomial over the step: depth, velocity, crank speed, or the distance of a force at
rest from its limit. A quantity that starts at zero is first divided by s, because that zero is not an event.
"""

from typing import NamedTuple

from plant_sim.arrays import FloatArray
from plant_sim.kernels import subroutine
from plant_sim.solvers.adaptive.state_layout import Flow, Memory
from plant_sim.solvers.bernstein import at
from plant_sim.solvers.event import Event


class Segment(NamedTuple):
    """A step as it was computed: its constants, its length, and the motion within it.

    The motion is a Taylor series of this order in `memory.series`, or has slopes in the stages of DOP853,
    `memory.slopes`. `dense` is the place of its Bernstein coefficients.
    """

    flow: Flow
    h_s: float
    is_series: bool
    order: int
    dense: FloatArray


class Found(NamedTuple):
    """The first event of a step and its place in the step, 0 to 1."""

    event: Event
    s: float


@subroutine
def earlier(found: Found, event: Event, s: float) -> Found:
    """The earlier one of `found` and this event."""
    if s < found.s:
        return Found(event, s)
    return found


@subroutine
def look_within(memory: Memory, dense: FloatArray, s: float, out: FloatArray) -> None:
    """The motion within a step, into `out`."""
    for index in range(memory.progress.motion):
        i = memory.places[index]
        out[i] = at(dense[i], s)


@subroutine
def steepest(memory: Memory, segment: Segment, row: int) -> float:
    """A bound of a quantity's slope within a step, of either sign: Σ j |c_j| hʲ⁻¹, or twice the largest slope
    of a stage."""
    if not segment.is_series:
        return 2.0 * steepest_stage(memory.slopes, row)
    total = 0.0
    for j in range(segment.order, 0, -1):
        total = total * segment.h_s + j * abs(memory.all_series[row, j])
    return total


@subroutine
def steepest_stage(k: FloatArray, row: int) -> float:
    """A quantity's largest slope, of either sign, in the stages of a step."""
    largest = 0.0
    for stage in range(12):
        largest = max(largest, abs(k[stage, row]))
    return largest
