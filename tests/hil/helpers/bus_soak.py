"""The project's frames on the modelled bus for a long time, to hold the response-time analysis against.

Each node ticks on its own clock, so that phases slide past one another; it queues late by up to its jitter;
frames sent on events come at their smallest gap or seldom; and now and then a node saves its slow frames up
for one tick. All of that lies within what the analysis assumes, so no response may exceed its bound.
"""

import heapq
import random
from collections import defaultdict, deque
from collections.abc import Sequence
from typing import NamedTuple

from firmware_py.interface.frame import Frame
from hil.can_model.bits import bit_ns_of
from hil.can_model.core import advance, queue
from hil.can_model.schedulability import ErrorModel, Stream
from hil.can_model.state import Arrival, BusState, Corruption, NodeState

NS_PER_S = 1_000_000_000
SLOWEST_CLOCK_PPM = 300
"""Clocks only lose time: a faster one would break the periods that the analysis assumes."""
PAYLOADS = 16
QUEUE_FRAMES = 10_000
SAVE_UP_ODDS = 200
"""Once in this number of ticks, a node begins to save up its slow frames …"""
SAVE_UP_TICKS = 12
"""… for this number of ticks."""


class Worst(NamedTuple):
    """What one stream met."""

    stream: Stream
    response_ns: int
    frames: int


class Soak(NamedTuple):
    """What all streams met, in the order they were given, and the bus's own counts."""

    worst: list[Worst]
    errors: int
    load: float
    waiting: int
    """Frames still queued at the end."""


class _Source:
    """One stream at its node."""

    def __init__(self, stream: Stream, dice: random.Random) -> None:
        self.stream = stream
        self.due_ns = dice.randrange(stream.period_ns)
        self.payloads = [_payload(stream, dice) for _ in range(PAYLOADS)]
        self.worst_ns = 0
        self.frames = 0


def _payload(stream: Stream, dice: random.Random) -> Frame:
    """Random data, or data that is stuffed most."""
    if dice.random() < 0.5:
        return Frame(stream.can_id, dice.randbytes(stream.length))
    return Frame(stream.can_id, (dice.choice([b"\x01", b"\x0f", b"\x07"]) + b"\xe1" * 7)[: stream.length])


class _Sender:
    """One node: its clock, and what it queues at a tick."""

    def __init__(self, number: int, sources: Sequence[_Source], tick_ns: int, dice: random.Random) -> None:
        self.number = number
        self.every_tick = [source for source in sources if source.stream.period_ns == tick_ns]
        self.slow = [source for source in sources if source.stream.period_ns != tick_ns]
        self.paced = any(source.stream.pacing is not None for source in self.slow)
        self.jitter_ns = min(source.stream.jitter_ns for source in sources)
        self.period_ns = tick_ns + tick_ns * dice.randrange(SLOWEST_CLOCK_PPM) // 1_000_000
        self.tick_ns = dice.randrange(tick_ns)
        self.saving_ticks = 0

    def due(self, dice: random.Random) -> list[_Source]:
        """What this tick queues."""
        if self.saving_ticks:
            self.saving_ticks -= 1
            return self.every_tick
        if not dice.randrange(SAVE_UP_ODDS):
            self.saving_ticks = SAVE_UP_TICKS
        slow = [source for source in self.slow if source.due_ns <= self.tick_ns]
        if self.paced and len(slow) > 1:
            slow = [dice.choice(slow)]
        for source in slow:
            source.due_ns = self.tick_ns + source.stream.period_ns
        return self.every_tick + slow


def soak(
    streams: Sequence[Stream],
    bitrate: int,
    tick_ns: int,
    duration_s: float,
    seed: int,
    errors: ErrorModel | None = None,
) -> Soak:
    """Play `streams` for `duration_s` simulated seconds; destroy transmissions as `errors` allows."""
    dice = random.Random(seed)
    bit_ns = bit_ns_of(bitrate)
    names = sorted({stream.sender for stream in streams})
    sources = [_Source(stream, dice) for stream in streams]
    queued: dict[tuple[int, int], deque[tuple[_Source, int]]] = defaultdict(deque)
    """By node and identifier, oldest first: two streams of a node may share an identifier."""
    senders = [
        _Sender(number, [source for source in sources if source.stream.sender == name], tick_ns, dice)
        for number, name in enumerate(names)
    ]
    # One node more, which only listens and acknowledges.
    state = BusState(nodes=tuple(NodeState() for _ in range(len(names) + 1)))
    end_ns = round(duration_s * NS_PER_S)
    next_error_ns = end_ns if errors is None else 0

    def note(arrivals: Sequence[Arrival]) -> None:
        for arrival in arrivals:
            for number in arrival.senders:
                source, queued_ns = queued[number, arrival.pending.can_id].popleft()
                response_ns = arrival.bit * bit_ns - queued_ns
                source.worst_ns = max(source.worst_ns, response_ns)
                source.frames += 1

    ticks = [(sender.tick_ns, sender.number) for sender in senders]
    heapq.heapify(ticks)
    while ticks[0][0] < end_ns:
        now_ns, number = ticks[0]
        state, arrivals = advance(state, -(-now_ns // bit_ns))
        note(arrivals)
        if errors is not None and now_ns >= next_error_ns and not state.corruptions:
            state = state._replace(corruptions=(Corruption(hits=errors.burst),))
            next_error_ns = now_ns + 2 * errors.gap_ns
        sender = senders[number]
        for source in sender.due(dice):
            queued[number, source.stream.can_id].append((source, sender.tick_ns))
            state = queue(state, number, dice.choice(source.payloads), QUEUE_FRAMES)
        sender.tick_ns += sender.period_ns
        heapq.heapreplace(ticks, (sender.tick_ns + dice.randint(0, sender.jitter_ns), number))
    state, arrivals = advance(state, -(-end_ns // bit_ns))
    note(arrivals)
    return Soak(
        [Worst(source.stream, source.worst_ns, source.frames) for source in sources],
        state.errors,
        state.busy_bits * bit_ns / end_ns,
        sum(len(node.queue) for node in state.nodes),
    )
