"""The bus model against a reference that plays every bit of every node."""

from collections.abc import Sequence
from typing import NamedTuple

import pytest
from bitwise_can import Bus, LeftOutError, Node, Phase
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st

from firmware_py.interface.frame import Frame
from hil.can_model.core import advance, queue
from hil.can_model.errors_on_the_wire import disturbed_bit
from hil.can_model.fault_confinement import ErrorCounters
from hil.can_model.state import Arrival, BusState, Corruption, NodeState

SHORT = Frame(0x100, b"")
LONG = Frame(0x200, bytes.fromhex("0123456789abcdef"))


class Entry(NamedTuple):
    """A frame queued by a node at a bit time."""

    bit: int
    node: int
    frame: Frame


class Play(NamedTuple):
    """What both report of the same traffic."""

    received: list[list[tuple[int, Frame]]]
    waiting: list[list[Frame]]
    counters: list[tuple[int, int]]


def modelled(nodes: Sequence[NodeState], entries: Sequence[Entry], end: int, hits: dict[int, int]) -> Play:
    """Play `entries`; `hits`: by number of the transmission, the bit after arbitration that is inverted."""
    state = BusState(nodes=tuple(nodes))
    state = state._replace(corruptions=corruptions(hits))
    arrivals: list[Arrival] = []
    for entry in sorted(entries, key=lambda entry: entry.bit):
        state, more = advance(state, entry.bit)
        arrivals += more
        state = queue(state, entry.node, entry.frame, depth=1000)
    state, more = advance(state, end)
    arrivals += more
    received: list[list[tuple[int, Frame]]] = [[] for _ in nodes]
    for arrival in arrivals:
        for node in arrival.receivers:
            received[node].append((arrival.bit, arrival.pending.frame))
    return Play(
        received,
        [[pending.frame for pending in node.queue] for node in state.nodes],
        [(node.counters.transmit, node.counters.receive) for node in state.nodes],
    )


def corruptions(hits: dict[int, int]) -> tuple[Corruption, ...]:
    """One corruption a hit, each counting all transmissions from the first on."""
    return tuple(Corruption(skip=number, bit=bit) for number, bit in hits.items())


def bit_by_bit(nodes: Sequence[NodeState], entries: Sequence[Entry], end: int, hits: dict[int, int]) -> Play:
    """Play the same on the reference. The bit of a hit depends on the frame, so look at it when it starts."""
    reference = [Node(node.counters.transmit, node.counters.receive) for node in nodes]
    for node in reference:
        if node.tec >= 256:
            node.phase = Phase.OFF
    bus = Bus(reference)
    ordered = sorted(entries, key=lambda entry: entry.bit)
    while bus.now < end:
        while ordered and ordered[0].bit == bus.now:
            entry = ordered.pop(0)
            bus.queue(entry.node, entry.frame)
        bus.run(bus.now + 1)
        if bus.starts and bus.starts[-1] == bus.now - 1 and len(bus.starts) - 1 in hits:
            started = [node.current for node in reference if node.transmitter and node.current is not None]
            frame = min(started)[2]
            bus.flips[len(bus.starts) - 1] = disturbed_bit(frame, hits[len(bus.starts) - 1])
    # a frame is valid for its receivers one bit before its end
    received = [[(bit + 1, frame) for bit, frame in node.received] for node in reference]
    waiting = [[frame for _, _, frame in sorted(node.waiting)] for node in reference]
    return Play(received, waiting, [(node.tec, node.rec) for node in reference])


def assert_agree(
    nodes: Sequence[NodeState], entries: Sequence[Entry], end: int, hits: dict[int, int] | None = None
) -> Play:
    model = modelled(nodes, entries, end, hits or {})
    try:
        reference = bit_by_bit(nodes, entries, end, hits or {})
    except LeftOutError:
        reject()
    assert model == reference
    return model


payloads = st.binary(max_size=8) | st.sampled_from(
    [bytes.fromhex("01e1e1e1e1e1e1e1"), bytes(8), b"\xff" * 8, bytes.fromhex("7c3c"), b"\x55" * 5]
)


@st.composite
def stories(draw: st.DrawFn, nodes: int) -> list[Entry]:
    """Up to a dozen frames; no two nodes share an identifier."""
    entries = []
    for _ in range(draw(st.integers(1, 12))):
        node = draw(st.integers(0, nodes - 1))
        can_id = draw(st.sampled_from([0, 1, 0x0F, 0x10, 0x3F, 0x1F0, 0x3E0, 0x7F0 // 4])) * 4 + node
        bit = draw(st.integers(0, 400) | st.sampled_from([0, 1, 100, 101]))
        entries.append(Entry(bit, node, Frame(can_id & 0x7FF, draw(payloads))))
    return entries


@settings(max_examples=40)
@given(entries=stories(nodes=3))
def test_arbitration_and_timing_are_those_of_the_reference(entries: list[Entry]) -> None:
    play = assert_agree([NodeState()] * 3, entries, end=2400)
    assert sum(len(received) for received in play.received) == 2 * len(entries)


@settings(max_examples=60)
@given(
    entries=stories(nodes=3),
    hits=st.dictionaries(st.integers(0, 12), st.integers(0, 130), min_size=1, max_size=6),
)
def test_disturbed_frames_are_those_of_the_reference(entries: list[Entry], hits: dict[int, int]) -> None:
    play = assert_agree([NodeState()] * 3, entries, end=2900, hits=hits)
    assert play.waiting == [[], [], []]


@settings(max_examples=40)
@given(
    transmit_errors=st.integers(100, 255),
    payload=payloads,
    hits=st.dictionaries(st.integers(0, 6), st.integers(0, 130), min_size=1, max_size=5),
    receivers=st.integers(1, 2),
)
def test_a_failing_sender_up_to_bus_off_and_back(
    transmit_errors: int, payload: bytes, hits: dict[int, int], receivers: int
) -> None:
    nodes = [NodeState(counters=ErrorCounters(transmit_errors, 0))] + [NodeState()] * receivers
    entries = [Entry(0, 0, Frame(0x0F0, payload)), Entry(0, 0, LONG), Entry(2500, 0, SHORT)]
    assert_agree(nodes, entries, end=4200, hits=hits)


@settings(max_examples=15)
@given(traffic=st.lists(payloads, min_size=1, max_size=4), gap=st.integers(20, 300), hit=st.integers(0, 130))
def test_recovery_counts_recessive_bits_between_others_frames(
    traffic: list[bytes], gap: int, hit: int
) -> None:
    """Node 0 goes off with its first frame; node 1 talks meanwhile; node 0 is received again in time."""
    nodes = [NodeState(counters=ErrorCounters(248, 0)), NodeState(), NodeState()]
    others = [Frame(can_id, data) for can_id, data in enumerate(traffic, start=3)]
    entries = [Entry(0, 0, Frame(0, b"\x12"))]
    entries += [Entry(200 + k * (135 + gap), 1, others[k % len(others)]) for k in range(12)]
    entries += [Entry(bit, 0, Frame(2, b"")) for bit in range(1300, 4500, 97)]
    play = assert_agree(nodes, entries, end=6000, hits={0: hit})
    assert play.counters[0] == (0, 0)
    assert (2, b"") in [frame for _, frame in play.received[1]]


@settings(max_examples=40)
@given(data=st.lists(payloads, min_size=2, max_size=3), listeners=st.integers(0, 1), bit=st.integers(0, 60))
def test_equal_identifiers_collide_as_in_the_reference(data: list[bytes], listeners: int, bit: int) -> None:
    """Up to the fifteenth collision; with the next one, error-passive nodes come in."""
    assume(listeners or len(set(data)) > 1)
    nodes = [NodeState()] * (len(data) + listeners)
    entries = [Entry(bit, node, Frame(0x123, payload)) for node, payload in enumerate(data)]
    starts, idle_bit = starts_until_idle(nodes, entries, errors=15)
    assert_agree(nodes, entries, idle_bit)
    bus = Bus([Node() for _ in nodes])
    bus.run(bit)
    for entry in entries:
        bus.queue(entry.node, entry.frame)
    bus.run(idle_bit)
    assert bus.starts == starts


def starts_until_idle(
    nodes: Sequence[NodeState], entries: Sequence[Entry], errors: int
) -> tuple[list[int], int]:
    """When transmissions begin, and when the bus is idle after `errors` errors or the last frame."""
    state, _ = advance(BusState(nodes=tuple(nodes)), entries[0].bit)
    for entry in entries:
        state = queue(state, entry.node, entry.frame, depth=1000)
    starts = []
    while state.errors < errors and any(node.queue for node in state.nodes):
        starts.append(max(state.idle_from_bit, state.now_bit))
        state, _ = advance(state, starts[-1] + 1)
    return starts, state.idle_from_bit


@pytest.mark.parametrize("frame", [Frame(0x100, b""), LONG, Frame(0x0F0, b"\xff" * 8)])
def test_a_node_that_is_off_counts_the_silence_of_an_error_passive_sender(frame: Frame) -> None:
    """Nobody acknowledges, and no flag is dominant: every attempt leaves a longer run of recessive bits."""
    nodes = [
        NodeState(counters=ErrorCounters(130, 0)),
        NodeState(counters=ErrorCounters(256, 0), sequences_left=128),
    ]
    play = assert_agree(nodes, [Entry(0, 0, frame)], end=12_000)
    assert [received for _, received in play.received[1]] == [frame]


@pytest.mark.parametrize(("before", "after"), [(0, 128), (100, 132), (128, 128), (200, 200)])
def test_a_node_alone_turns_error_passive_and_stays_there(before: int, after: int) -> None:
    nodes = [NodeState(counters=ErrorCounters(before, 0))]
    play = assert_agree(nodes, [Entry(3, 0, LONG)], end=6000)
    assert play.counters == [(after, 0)]
    assert play.waiting == [[LONG]]


@settings(max_examples=30)
@given(
    payload=payloads,
    skip=st.integers(0, 2),
    hits=st.integers(1, 4),
    receivers=st.integers(1, 3),
    sender=st.integers(0, 160),
)
def test_one_receiver_that_finds_the_checksum_wrong(
    payload: bytes, skip: int, hits: int, receivers: int, sender: int
) -> None:
    deaf = 1
    nodes = [NodeState(counters=ErrorCounters(sender, 0))] + [NodeState()] * receivers
    entries = [Entry(5 + 3 * k, 0, Frame(0x100 + k, payload)) for k in range(4)]
    state = BusState(nodes=tuple(nodes), corruptions=(Corruption(skip=skip, hits=hits, seen_by=deaf),))
    reference = [Node(node.counters.transmit, node.counters.receive) for node in nodes]
    attempts = iter(range(100))
    reference[deaf].deaf_to = lambda frame: skip <= next(attempts) < skip + hits
    bus = Bus(reference)
    arrivals: list[Arrival] = []
    for entry in entries:
        bus.run(entry.bit)
        bus.queue(0, entry.frame)
        state, more = advance(state, entry.bit)
        arrivals += more
        state = queue(state, 0, entry.frame, depth=10)
    bus.run(1500)
    state, more = advance(state, 1500)
    arrivals += more
    for number, node in enumerate(reference):
        assert state.nodes[number].counters == (node.tec, node.rec)
        arrived = [
            (arrival.bit, arrival.pending.frame) for arrival in arrivals if number in arrival.receivers
        ]
        assert arrived == [(bit + 1, frame) for bit, frame in node.received]
