"""Receiving: the frames that begin a sample, the time of a sample, and the waiting parameter requests."""

from typing import NamedTuple, TypeVar

from firmware_py.interface.arrivals import Arrival
from firmware_py.interface.counters import Counters, counted
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.framing import counter_of
from firmware_py.interface.generated import kinds, received
from firmware_py.interface.generated.received import Received
from firmware_py.interface.generated.records import ParameterRequest

Item = TypeVar("Item")

LONGEST_DATED_TICKS = (1 << kinds.ACCELEROMETER.counter_bits) - 2
"""Longest time since the last sample for which a sample's counter gives its tick, to within one tick."""


class Requests(NamedTuple):
    """Parameter requests: the first `number` elements of `waiting` are not answered yet.

    Four places suffice: a client waits for an answer before it sends another request.
    """

    waiting: tuple[ParameterRequest, ParameterRequest, ParameterRequest, ParameterRequest]
    number: int


NO_REQUEST = received.INITIAL.parameter_request
NO_REQUESTS = Requests((NO_REQUEST, NO_REQUEST, NO_REQUEST, NO_REQUEST), 0)


def with_one(
    waiting: tuple[Item, Item, Item, Item], count: int, one: Item
) -> tuple[tuple[Item, Item, Item, Item], int, int]:
    """Add `one` to four places, of which `count` are occupied: `(places, count, lost)`; lost is 1 if full."""
    first, second, third, fourth = waiting
    if count == 0:
        return (one, second, third, fourth), 1, 0
    if count == 1:
        return (first, one, third, fourth), 2, 0
    if count == 2:
        return (first, second, one, fourth), 3, 0
    if count == 3:
        return (first, second, third, one), 4, 0
    return waiting, count, 1


def receive(
    tick_s: float, before: Received, requests: Requests, counters: Counters, tick: int, frame: WordFrame
) -> tuple[Received, Requests, Counters, bool]:
    """Process one frame that arrived before tick number `tick`; the last element: whether it is used."""
    now, counters, usable = received.receive(tick_s, before, counters, tick, frame)
    if usable and frame.can_id == kinds.PARAMETER_REQUEST.can_id:
        waiting, number, lost = with_one(requests.waiting, requests.number, now.parameter_request)
        requests = Requests(waiting, number)
        counters = counted(counters, 0, 0, lost)
    return now, requests, counters, usable


def begins_sample(before: Received, tick: int, frame: WordFrame, first_id: int) -> bool:
    """Whether a frame received in `tick` belongs to a new sample.

    A sample is an accelerometer frame and its encoder frame; the frame with `first_id` comes first.
    """
    if frame.can_id != first_id or before.accelerometer_arrival.tick != tick:
        return False
    own = before.accelerometer_arrival.counter
    return frame.can_id != kinds.ACCELEROMETER.can_id or counter_of(kinds.ACCELEROMETER, frame.word) != own


def sampled_tick(last: Arrival, newest: Arrival) -> int:
    """The tick of the newest sample, from the difference of its counter and that of `last`."""
    modulus = 1 << kinds.ACCELEROMETER.counter_bits
    return last.tick + (newest.counter - last.counter) % modulus
