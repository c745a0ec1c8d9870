"""Worst-case response times of frames on a CAN bus.

Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: Refuted, revisited and
revised", Real-Time Systems 35:239–272, 2007: fixed priorities by identifier, transmission without preemption,
and an analysis of every instance within the busy period, not only of the first as in the analysis of 1994
that the paper refutes. A response time runs from the instant at which a punctual sender would have queued the
frame to the end of the intermission after the frame.

In extension of the paper, a sender may pace its frames: of the streams that share one `Pacing` it queues at
most one frame within each slot. This bounds their interference; the busy-period argument requires only an
upper bound on the frames queued within a window.

All times are integer nanoseconds, so that every ceiling is exact.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from itertools import groupby
from typing import NamedTuple

from hil.bus.model.bits import ERROR_FRAME_BITS, INTERMISSION_BITS, SUSPEND_BITS

ERROR_BITS = ERROR_FRAME_BITS + INTERMISSION_BITS + SUSPEND_BITS
"""Largest cost of an error in bits, without the frame's repetition: the error frame, the intermission, and
the bits for which an error-passive sender suspends transmission."""

MAX_ITERATIONS = 100_000


class SchedulabilityError(RuntimeError):
    """The analysis did not converge."""


class Pacing(NamedTuple):
    """A limit on streams: `sender` queues at most one of their frames in every `slot_ns`."""

    sender: str
    slot_ns: int


class Stream(NamedTuple):
    """Frames of one identifier and `length` data bytes from one sender; a lower identifier has priority.

    `period_ns`: smallest time between two frames. `jitter_ns`: largest delay with which the sender queues a
    frame. The sender queues its frames in order.
    """

    can_id: int
    name: str
    sender: str
    length: int
    period_ns: int
    jitter_ns: int
    deadline_ns: int
    transmission_ns: int
    pacing: Pacing | None = None


class ErrorModel(NamedTuple):
    """Destroyed transmissions: at most `burst` at any time, and one more in every `gap_ns`."""

    burst: int
    gap_ns: int


class Response(NamedTuple):
    """The worst case of a stream. `response_ns` is None if it is unbounded."""

    stream: Stream
    blocking_ns: int
    instances: int
    response_ns: int | None

    @property
    def in_time(self) -> bool:
        """Whether every frame's transmission ends before its deadline."""
        return self.response_ns is not None and self.response_ns <= self.stream.deadline_ns


def response_times(
    streams: Sequence[Stream], bit_ns: int, errors: ErrorModel | None = None
) -> list[Response]:
    """Return every stream's worst case, in order of priority; without `errors` no transmission fails."""
    order = sorted(streams, key=lambda stream: stream.can_id)
    return [_response(stream, order, bit_ns, errors) for stream in order]


def load(streams: Sequence[Stream]) -> Fraction:
    """Return the share of the bus's time that `streams` take in the long run."""
    total = Fraction(0)
    for pacing, members in _groups(streams):
        if pacing is None:
            total += sum(Fraction(member.transmission_ns, member.period_ns) for member in members)
            continue
        slots = Fraction(1, pacing.slot_ns)
        for member in members:  # the longest frames take the slots first
            taken = min(slots, Fraction(1, member.period_ns))
            total += taken * member.transmission_ns
            slots -= taken
    return total


def _groups(streams: Sequence[Stream]) -> list[tuple[Pacing | None, list[Stream]]]:
    """Streams by pacing, the longest frames of each first."""

    def key(stream: Stream) -> tuple[bool, str, int, int]:
        pacing = stream.pacing or Pacing("", 0)
        return (stream.pacing is None, *pacing, -stream.transmission_ns)

    ordered = sorted(streams, key=key)
    return [(pacing, list(members)) for pacing, members in groupby(ordered, key=lambda s: s.pacing)]


def _most_queued(period_ns: int, jitter_ns: int, window_ns: int) -> int:
    """Return the largest number of events within `window_ns`, including its first instant."""
    return -(-(window_ns + jitter_ns) // period_ns)


def _interference(groups: Sequence[tuple[Pacing | None, Sequence[Stream]]], window_ns: int) -> int:
    """Return the bus time of the frames that `groups` can queue within `window_ns`."""
    total_ns = 0
    for pacing, members in groups:
        if pacing is None:
            for member in members:
                queued = _most_queued(member.period_ns, member.jitter_ns, window_ns)
                total_ns += queued * member.transmission_ns
            continue
        jitter_ns = max(member.jitter_ns for member in members)
        places = _most_queued(pacing.slot_ns, jitter_ns, window_ns)
        for member in members:
            queued = min(places, _most_queued(member.period_ns, member.jitter_ns, window_ns))
            total_ns += queued * member.transmission_ns
            places -= queued
    return total_ns


def _response(stream: Stream, order: Sequence[Stream], bit_ns: int, errors: ErrorModel | None) -> Response:
    # Two streams with the same identifier wait for each other as for a higher priority.
    higher = [other for other in order if other.can_id <= stream.can_id and other is not stream]
    # A frame of lower priority may have just started.
    blocking_ns = max((other.transmission_ns for other in order if other.can_id > stream.can_id), default=0)
    unbounded = Response(stream, blocking_ns, 0, None)
    longest_ns = max(other.transmission_ns for other in (stream, *higher))
    error_ns = ERROR_BITS * bit_ns + longest_ns

    errors_load = Fraction(0) if errors is None else Fraction(error_ns, errors.gap_ns)
    if load([stream, *higher]) + errors_load >= 1:
        return unbounded

    def lost_ns(window_ns: int) -> int:
        """E_m(t): bus time that errors take within a window."""
        if errors is None:
            return 0
        return (errors.burst + window_ns // errors.gap_ns) * error_ns

    hp_groups = _groups(higher)
    hep_groups = _groups([*higher, stream])

    def queued_ns(instance: int, wait_ns: int) -> int:
        # w = E(w + C) + B + q C + Σ_{hp} ⌈(w + J + τ)/T⌉ C   (w never decreases with q)
        return (
            lost_ns(wait_ns + stream.transmission_ns)
            + blocking_ns
            + instance * stream.transmission_ns
            + _interference(hp_groups, wait_ns + bit_ns)
        )

    # t = E(t) + B + Σ_{hep} ⌈(t + J)/T⌉ C   (busy period)
    busy_ns = _fixed_point(
        lambda busy_ns: lost_ns(busy_ns) + blocking_ns + _interference(hep_groups, busy_ns),
        stream.transmission_ns,
        stream,
    )
    instances = _most_queued(stream.period_ns, stream.jitter_ns, busy_ns)

    worst_ns = 0
    wait_ns = blocking_ns
    for instance in range(instances):
        wait_ns = _fixed_point(partial(queued_ns, instance), wait_ns, stream)
        # R(q) = J + w(q) − q T + C
        response_ns = stream.jitter_ns + wait_ns - instance * stream.period_ns + stream.transmission_ns
        worst_ns = max(worst_ns, response_ns)
    return Response(stream, blocking_ns, instances, worst_ns)


def _fixed_point(step: Callable[[int], int], from_ns: int, stream: Stream) -> int:
    """Repeat `step` from `from_ns` on until it returns its argument."""
    for _ in range(MAX_ITERATIONS):
        next_ns = step(from_ns)
        if next_ns == from_ns:
            return next_ns
        from_ns = next_ns
    raise SchedulabilityError(
        f"{stream.name}: no end of its busy period after {MAX_ITERATIONS} steps; the bus is loaded to within "
        "a hair of 1: lower a rate or raise the bit rate"
    )


def seconds(time_ns: int | None) -> float:
    """Convert nanoseconds to seconds; None (unbounded) becomes infinity."""
    return math.inf if time_ns is None else time_ns * 1e-9
