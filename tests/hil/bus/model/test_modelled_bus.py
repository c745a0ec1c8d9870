"""The modelled bus as its users see it, with times and counters worked out by hand."""

import random
from collections.abc import Callable, Sequence
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.interface.frame import Frame
from hil.bus.model import fault_confinement as rules
from hil.bus.model.bits import frame_bits
from hil.bus.model.fault_confinement import ErrorCounters, ErrorState
from hil.bus.model.modelled_bus import Delivery, ModelledBus

US = 1000
NODES = ("a", "b", "c")
SHORT = Frame(0x100, b"")
LONG = Frame(0x200, bytes.fromhex("0123456789abcdef"))


def bus_of(*nodes: str, bitrate: int = 1_000_000) -> ModelledBus:
    return ModelledBus(nodes or NODES, bitrate)


def lost(bus: ModelledBus) -> int:
    """Frames that a node has refused or discarded."""
    return sum(bus.join(name).lost for name in NODES)


def received(deliveries: Sequence[Delivery]) -> list[tuple[int, str, int]]:
    return [(delivery.t_ns, delivery.sender, delivery.frame.can_id) for delivery in deliveries]


@pytest.mark.parametrize(("bitrate", "bit_ns"), [(1_000_000, 1000), (500_000, 2000), (250_000, 4000)])
def test_a_frame_arrives_at_its_end_without_the_intermission(bitrate: int, bit_ns: int) -> None:
    bus = bus_of(bitrate=bitrate)
    bus.submit("a", LONG, 7 * bit_ns - 1)  # the node begins with the next whole bit
    end_ns = 7 * bit_ns + (frame_bits(LONG) - 3) * bit_ns
    assert bus.deliver(end_ns - 1) == []
    assert bus.deliver(end_ns) == [Delivery(end_ns, "a", LONG, ("b", "c"))]
    assert bus.deliver(end_ns + 1_000_000) == []
    assert bus.destroyed == lost(bus) == 0


@pytest.mark.parametrize(
    ("queued", "order"),
    [
        # (node, identifier) all at once: the lowest identifier first, whoever sends it
        ([("a", 3), ("b", 2), ("c", 1)], [1, 2, 3]),
        ([("a", 1), ("b", 2), ("c", 3)], [1, 2, 3]),
        ([("a", 0x7FF), ("b", 0x000), ("c", 0x3FF)], [0x000, 0x3FF, 0x7FF]),
        ([("a", 0x400), ("b", 0x3FF)], [0x3FF, 0x400]),
        # a node's queue is in order of priority too
        ([("a", 9), ("a", 5), ("a", 7), ("b", 6)], [5, 6, 7, 9]),
    ],
)
def test_arbitration(queued: list[tuple[str, int]], order: list[int]) -> None:
    bus = bus_of()
    frames = {can_id: Frame(can_id, bytes([can_id & 0xFF])) for _, can_id in queued}
    for node, can_id in queued:
        bus.submit(node, frames[can_id], 0)
    expected, start = [], 0
    for can_id in order:
        expected.append((start + frame_bits(frames[can_id]) - 3) * US)
        start += frame_bits(frames[can_id])
    arrived = bus.deliver(5_000 * US)
    assert [delivery.frame.can_id for delivery in arrived] == order
    assert [delivery.t_ns for delivery in arrived] == expected


def test_frames_of_one_identifier_stay_in_order() -> None:
    bus = bus_of()
    frames = [Frame(0x50, bytes([number])) for number in range(20)]
    for frame in frames:
        bus.submit("b", frame, 0)
    assert [delivery.frame for delivery in bus.deliver(10_000 * US)] == frames


def test_what_has_started_is_not_interrupted() -> None:
    urgent = Frame(0, b"")
    for queued_us, first in ((0, urgent), (1, LONG)):
        bus = bus_of()
        bus.submit("a", LONG, 0)
        bus.submit("b", urgent, queued_us * US)
        assert bus.deliver(1000 * US)[0].frame == first


def test_time_runs_one_way_only() -> None:
    bus = bus_of()
    bus.deliver(5 * US)
    with pytest.raises(ValueError, match="in the order of time"):
        bus.submit("a", SHORT, 4 * US)
    with pytest.raises(ValueError, match="in the order of time"):
        bus.deliver(4 * US)


def test_what_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="no node 'x' on this bus; it has a, b, c"):
        bus_of().submit("x", SHORT, 0)
    with pytest.raises(ValueError, match="wanted each once"):
        ModelledBus(["a", "a"])
    with pytest.raises(ValueError, match="bit rate 300000"):
        ModelledBus(["a"], 300_000)
    with pytest.raises(ValueError, match="no classic CAN frame"):
        bus_of().submit("a", Frame(0x800, b""), 0)


@settings(max_examples=40)
@given(
    entries=st.lists(
        st.tuples(st.integers(0, 400), st.sampled_from(NODES), st.integers(0, 0x7FF), st.binary(max_size=8)),
        max_size=12,
    ),
    cuts=st.lists(st.integers(0, 3000), max_size=8),
    seed=st.integers(0, 99),
)
def test_how_often_one_asks_changes_nothing(
    entries: list[tuple[int, str, int, bytes]], cuts: list[int], seed: int
) -> None:
    """Nor does anything but the calls: the same calls, the same deliveries."""

    def play(asked: list[int]) -> list[Delivery]:
        bus = bus_of()
        dice = random.Random(seed)
        bus.destroy({can_id for _, _, can_id, _ in entries if dice.random() < 0.3})
        arrived = []
        calls = [*((bit, entry) for entry in entries for bit in entry[:1]), *((cut, None) for cut in asked)]
        for bit, entry in sorted(calls, key=lambda call: call[0]):
            if entry is None:
                arrived += bus.deliver(bit * US)
            else:
                bus.submit(entry[1], Frame(*entry[2:]), bit * US)
        return arrived + bus.deliver(10_000 * US)

    whole = play([])
    assert play(cuts) == whole
    assert all(one.t_ns < other.t_ns for one, other in pairwise(whole))


def test_a_full_queue_loses_the_newest() -> None:
    bus = bus_of()
    for number in range(70):
        bus.submit("a", Frame(0x100, bytes([number])), 0)
    arrived = bus.deliver(100_000 * US)
    assert [delivery.frame.data[0] for delivery in arrived] == list(range(64))
    assert lost(bus) == 6


# --- errors by hand ------------------------------------------------------------------------------------


def test_a_destroyed_frame_is_repeated_after_the_longest_error_frame() -> None:
    """Whatever bit was hit: the whole frame, two error flags of 6 bits, and a delimiter of 8."""
    frame = Frame(0x2AA, b"")
    bus = bus_of()
    bus.destroy({0x2AA})
    bus.submit("a", frame, 0)
    assert bus.deliver(1 * US) == []  # it has started
    bus.destroy(())
    again = frame_bits(frame) + 2 * 6 + 8
    assert received(bus.deliver(1000 * US)) == [((again + frame_bits(frame) - 3) * US, "a", 0x2AA)]
    assert bus.counters("a") == (8 - 1, 0)
    assert bus.counters("b") == bus.counters("c") == (0, 0)  # 1 for the error, less 1 for the frame
    assert (bus.destroyed, lost(bus)) == (1, 0)


def test_only_transmissions_of_the_given_identifiers_are_destroyed() -> None:
    bus = bus_of()
    bus.destroy({0x200, 0x400})
    for can_id in (0x100, 0x200, 0x100, 0x200, 0x300):
        bus.submit("a", Frame(can_id, bytes([can_id >> 8])), 0)
    arrived = bus.deliver(500 * US)
    assert [delivery.frame.can_id for delivery in arrived] == [0x100, 0x100]
    errors = bus.destroyed
    assert errors > 3
    bus.destroy(())
    arrived = bus.deliver(10_000 * US)
    assert [delivery.frame.can_id for delivery in arrived] == [0x200, 0x200, 0x300]
    assert bus.destroyed == errors


RULES: dict[str, Callable[[ErrorCounters], ErrorCounters]] = {
    "transmit error": rules.after_transmit_error,
    "unacknowledged": rules.after_missing_acknowledgement,
    "sent": rules.after_transmitting,
    "received": rules.after_receiving,
    "receive error": rules.after_receive_error,
}
ACTIVE, PASSIVE, OFF = ErrorState.ERROR_ACTIVE, ErrorState.ERROR_PASSIVE, ErrorState.BUS_OFF


@pytest.mark.parametrize(
    ("steps", "counters", "error_state"),
    [
        (["transmit error"] * 15, (120, 0), ACTIVE),
        (["transmit error"] * 16, (128, 0), PASSIVE),
        (["transmit error"] * 16 + ["sent"], (127, 0), ACTIVE),
        (["transmit error"] * 31, (248, 0), PASSIVE),
        (["transmit error"] * 32, (256, 0), OFF),
        (["transmit error"] * 31 + ["sent", "transmit error"], (255, 0), PASSIVE),
        (["sent"] * 3, (0, 0), ACTIVE),
        (["transmit error"] + ["sent"] * 3, (5, 0), ACTIVE),
        (["unacknowledged"] * 16, (128, 0), PASSIVE),
        (["unacknowledged"] * 1000, (128, 0), PASSIVE),
        (["receive error"] * 127, (0, 127), ACTIVE),
        (["receive error"] * 128, (0, 128), PASSIVE),
        (["receive error"] * 1000, (0, 128), PASSIVE),
        (["receive error"] * 128 + ["received"], (0, 119), ACTIVE),
        (["receive error"] * 3 + ["received"] * 5, (0, 0), ACTIVE),
        (["transmit error", "receive error", "sent", "received"], (7, 0), ACTIVE),
    ],
)
def test_error_counters(steps: list[str], counters: tuple[int, int], error_state: ErrorState) -> None:
    state = ErrorCounters()
    for step in steps:
        state = RULES[step](state)
    assert state == counters
    assert state.error_state is error_state


def test_a_sender_goes_off_after_32_errors_in_a_row_and_the_others_stay() -> None:
    bus = bus_of()
    bus.destroy({SHORT.can_id})
    bus.submit("a", SHORT, 0)
    assert bus.deliver(10_000 * US) == []
    assert bus.destroyed == 32
    assert lost(bus) == 1
    assert bus.counters("b").receive == 32
    assert bus.counters("a").error_state is ACTIVE  # off, and back again meanwhile
    bus.destroy(())
    bus.submit("b", SHORT, 10_000 * US)
    assert bus.deliver(11_000 * US)[0].receivers == ("a", "c")


def test_an_idle_bus_lets_a_node_back_after_1408_bits() -> None:
    for late_bits, arrives in ((0, False), (1, True)):
        bus = bus_of()
        bus.deliver(100 * US)
        bus.switch_off("a")
        back_us = 100 + 128 * 11
        bus.submit("a", LONG, (back_us - 1 + late_bits) * US)
        assert bus.counters("a").error_state is (ACTIVE if arrives else OFF)
        assert bool(bus.deliver(5000 * US)) == arrives
        assert lost(bus) == (0 if arrives else 1)


def test_a_busy_bus_lets_a_node_back_after_128_frames() -> None:
    """The end of every frame is one run of 11 recessive bits; back to back, there is no other."""
    bus = bus_of()
    bus.switch_off("a")
    arrived: list[Delivery] = []
    t_us = 0
    while bus.counters("a").error_state is OFF:
        if t_us % 40 == 0:
            bus.submit("b", SHORT, t_us * US)
        t_us += 1
        arrived += bus.deliver(t_us * US)
    assert len(arrived) == 128
    assert t_us == 128 * frame_bits(SHORT)


def test_a_node_that_is_off_neither_receives_nor_acknowledges() -> None:
    bus = bus_of("a", "b")
    bus.switch_off("b")
    bus.submit("a", SHORT, 0)
    assert bus.deliver(1000 * US) == []
    assert bus.counters("a").transmit > 0
    arrived = bus.deliver(12_000 * US)  # b is back, and the frame is still being repeated
    assert received(arrived)[0][1:] == ("a", 0x100)
    assert arrived[0].t_ns > 1408 * US


def test_an_error_passive_sender_waits_for_the_others() -> None:
    """After its frame it keeps silent for 8 bits: a less urgent frame of another node goes first."""
    for errors, order in ((0, [0x10, 0x11, 0x200]), (130, [0x10, 0x200, 0x11])):
        bus = bus_of()
        bus.join("a").counters = ErrorCounters(errors, 0)
        for node, frame in (("a", Frame(0x10, b"")), ("a", Frame(0x11, b"")), ("b", LONG)):
            bus.submit(node, frame, 0)
        assert [delivery.frame.can_id for delivery in bus.deliver(1000 * US)] == order


def test_an_error_passive_sender_alone_waits_8_bits() -> None:
    bus = bus_of("a", "b")
    bus.join("a").counters = ErrorCounters(140, 0)
    for _ in range(2):
        bus.submit("a", SHORT, 0)
    first, second = bus.deliver(1000 * US)
    assert second.t_ns - first.t_ns == (frame_bits(SHORT) + 8) * US


def test_an_error_passive_rival_loses_without_a_trace() -> None:
    """Its flag is recessive: the frame of the same identifier that is dominant where they differ goes on."""
    bus = bus_of()
    bus.join("a").counters = ErrorCounters(150, 0)
    bus.submit("a", Frame(0x50, b"\xff"), 0)
    bus.submit("b", Frame(0x50, b"\x00"), 0)
    assert [(one.sender, one.receivers, one.frame.data) for one in bus.deliver(1000 * US)] == [
        ("b", ("c",), b"\x00"),
        ("a", ("b", "c"), b"\xff"),
    ]
    assert [bus.counters(name) for name in NODES] == [(150 + 8 - 1, 0), (0, 0), (0, 0)]


def test_equal_frames_at_the_same_time_are_one() -> None:
    bus = bus_of()
    bus.submit("a", SHORT, 0)
    bus.submit("b", SHORT, 0)
    assert bus.deliver(1000 * US) == [Delivery((frame_bits(SHORT) - 3) * US, "a", SHORT, ("c",))]


def test_a_node_with_anothers_identifier_drives_it_off() -> None:
    """Every collision costs both; who sends the more dominant data wins once the other is error-passive."""
    bus = bus_of()
    states_seen = set()
    for fifth_of_a_tick in range(250):
        t_ns = fifth_of_a_tick * 200 * US
        bus.submit("c", Frame(0x00E, bytes(8)), t_ns)
        if fifth_of_a_tick % 5 == 0:
            bus.submit("a", Frame(0x00E, b"\xff" * 8), t_ns)
            states_seen.add(bus.counters("a").error_state)
    assert bus.destroyed > 16
    assert PASSIVE in states_seen or OFF in states_seen


def test_nodes_of_one_process_meet_on_it_in_time() -> None:
    """What is sent at t_k is there half a tick later, less urgent frames only if the time was long enough."""
    bus = ModelledBus(["plant", "firmware"])
    plant, firmware = bus.join("plant"), bus.join("firmware")
    bus.move_to(1_000_000)
    plant.send_all([LONG, SHORT])
    assert len(bus.move_to(1_000_000 + (frame_bits(SHORT) + 20) * US)) == 1
    assert firmware.receive() == [SHORT]
    firmware.send_all([Frame(0x001, b"")])
    bus.move_to(1_500_000)
    assert firmware.receive() == [LONG]
    assert firmware.receive() == []
    assert plant.receive() == [Frame(0x001, b"")]
    bus.switch_off("firmware")
    firmware.send_all([SHORT])
    assert firmware.lost == 1
