"""The project's frames on the modelled bus: no response exceeds what the analysis promises."""

import random

import pytest
from bus_soak import soak

from firmware_py.interface.frame import Frame
from hil.can_model.bits import frame_bits
from hil.can_model.core import advance, queue
from hil.can_model.message_set import ALL_SENDERS, ONE_ERROR, TICK_NS, bus_streams
from hil.can_model.schedulability import ErrorModel, Stream, response_times
from hil.can_model.state import BusState, NodeState

BIT_NS = 1000


@pytest.mark.parametrize("paced", [frozenset(), ALL_SENDERS])
@pytest.mark.parametrize("errors", [None, ONE_ERROR])
def test_no_response_in_a_long_run_exceeds_its_bound(
    paced: frozenset[str], errors: ErrorModel | None
) -> None:
    streams = bus_streams(1_000_000, paced)
    played = soak(streams, 1_000_000, TICK_NS, duration_s=4.0, seed=3, errors=errors)
    bounds = response_times(streams, 1000, errors)
    assert played.waiting < 20
    assert (played.errors > 100) == (errors is not None)
    for worst, bound in zip(played.worst, bounds, strict=True):
        assert worst.stream == bound.stream
        assert worst.frames >= 4.0e9 / worst.stream.period_ns * 0.5
        assert bound.response_ns is not None
        assert worst.response_ns <= bound.response_ns
    assert (
        max(
            worst.response_ns / (bound.response_ns or 1)
            for worst, bound in zip(played.worst, bounds, strict=True)
        )
        > 0.5
    )


def stuffed_most(stream: Stream, dice: random.Random) -> Frame:
    """A long frame of this identifier and length."""
    pieces = [b"\x01", b"\x0f", b"\x07", b"\x1e", b"\x87", b"\xe1", b"\x78", b"\x3c"]
    frames = [
        Frame(stream.can_id, b"".join(dice.choice(pieces) for _ in range(stream.length))) for _ in range(400)
    ]
    return max(frames, key=frame_bits)


def test_the_critical_instant_reaches_the_bound() -> None:
    """All frames at once, one bit after the longest less urgent one has begun: the bound for frames of
    exactly these lengths, less that bit. Of streams that share an identifier one is played, since for both
    together the bound is safe, not exact."""
    streams = [stream._replace(jitter_ns=0) for stream in bus_streams(1_000_000, paced=())]
    streams = list({stream.can_id: stream for stream in reversed(streams)}.values())
    names = sorted({stream.sender for stream in streams})
    dice = random.Random(5)
    frames = {stream.can_id: stuffed_most(stream, dice) for stream in streams}
    exact = [
        stream._replace(transmission_ns=frame_bits(frames[stream.can_id]) * BIT_NS) for stream in streams
    ]
    for bound in response_times(exact, BIT_NS):
        watched = bound.stream
        less_urgent = [frames[stream.can_id] for stream in streams if stream.can_id > watched.can_id]
        state = BusState(nodes=tuple(NodeState() for _ in range(len(names) + 2)))
        if less_urgent:
            state = queue(state, len(names), max(less_urgent, key=frame_bits), depth=1)
        longest_ns = 0
        for tick in range(8):
            state, arrivals = advance(state, 1 + tick * TICK_NS // BIT_NS)
            for arrival in arrivals:
                if arrival.pending.can_id == watched.can_id and arrival.senders != (len(names),):
                    waited_bits = arrival.bit + 3 - arrival.pending.queued_bit
                    longest_ns = max(longest_ns, waited_bits * BIT_NS)
            for stream in streams:
                if tick * TICK_NS % stream.period_ns == 0:
                    state = queue(state, names.index(stream.sender), frames[stream.can_id], depth=99)
        assert bound.response_ns is not None
        assert longest_ns == bound.response_ns - (BIT_NS if less_urgent else 0)
