"""The python-can interface `vibrohil`, held to what python-can's own tests ask of an interface.

Its tests (back2back_test, notifier_test) come with its repository and not with its wheel.
"""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from waiting import frames_within

from firmware_py.interface.frame import Frame
from hil.bus import ProvidedBus, join, provide
from hil.bus.wire import REMOTE_FLAG

Opener = Callable[..., can.BusABC]
TIMEOUT_S = 2.0

STANDARD = can.Message(arbitration_id=0x100, is_extended_id=False, data=range(8))
MESSAGES = {
    "standard": STANDARD,
    "extended": can.Message(arbitration_id=0x123456, is_extended_id=True, data=range(10, 18)),
    "remote": can.Message(arbitration_id=0x200, is_extended_id=False, is_remote_frame=True, dlc=4),
    "extended remote": can.Message(arbitration_id=0x123456, is_extended_id=True, is_remote_frame=True, dlc=8),
    "short": can.Message(arbitration_id=0x300, is_extended_id=False, data=[4, 5, 6]),
    "empty": can.Message(arbitration_id=0x7FF, is_extended_id=False),
    "highest identifier": can.Message(arbitration_id=0x1FFFFFFF, is_extended_id=True, data=b"\xff" * 8),
}


@pytest.fixture
def local() -> Iterator[ProvidedBus]:
    with provide("local") as provided:
        yield provided


@pytest.fixture(scope="module")
def shared() -> Iterator[ProvidedBus]:
    """The hub of tests that leave it as it was."""
    with provide("local") as provided:
        yield provided


@pytest.fixture
def opened(shared: ProvidedBus) -> Iterator[Opener]:
    """Opens buses on the shared hub, and closes them."""
    buses: list[can.BusABC] = []

    def opener(kind: Callable[..., can.BusABC] = can.Bus, **options: Any) -> can.BusABC:
        buses.append(kind(channel=path_of(shared), interface="vibrohil", bitrate=500_000, **options))
        return buses[-1]

    yield opener
    for bus in buses:
        bus.shutdown()


def path_of(local: ProvidedBus) -> str:
    return local.address.removeprefix("local:")


@pytest.mark.parametrize("sent", MESSAGES.values(), ids=MESSAGES)
def test_messages_go_both_ways_unchanged_and_not_to_their_sender(opened: Opener, sent: can.Message) -> None:
    first, second = opened(), opened()
    for sender, receiver in ((first, second), (second, first)):
        before_s = time.time()
        sender.send(sent)
        received = receiver.recv(TIMEOUT_S)
        assert received is not None
        assert before_s <= received.timestamp <= time.time()
        assert received.equals(sent, timestamp_delta=None, check_channel=False)
        assert sender.recv(0) is None


@pytest.mark.parametrize("option", ["fd", "receive_own_messages"])
def test_what_the_bus_does_not_carry_is_refused(opened: Opener, option: str) -> None:
    with pytest.raises(can.CanInitializationError, match=f"leave .*`{option}`"):
        opened(**{option: True})


def test_filters(opened: Opener) -> None:
    sender, receiver = opened(), opened()
    receiver.set_filters([{"can_id": 0x123, "can_mask": 0xFF, "extended": True}])
    for arbitration_id in (0x02, 0x123, 0x223, 0x124):
        sender.send(can.Message(arbitration_id=arbitration_id, is_extended_id=True))
    sender.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    received = [receiver.recv(TIMEOUT_S) for _ in range(2)]
    assert [message.arbitration_id for message in received if message] == [0x123, 0x223]
    assert receiver.recv(0.05) is None


def test_an_asyncio_notifier_passes_a_bundle_on_without_waiting_for_the_next(local: ProvidedBus) -> None:
    """It takes one message each time the descriptor is readable."""

    async def listen() -> list[int]:
        with can.Bus(path_of(local), "vibrohil") as receiver:
            reader = can.AsyncBufferedReader()
            notifier = can.Notifier(receiver, [reader], loop=asyncio.get_running_loop())
            sender = join(local.address)
            sender.send_all([Frame(can_id, b"") for can_id in range(500)])
            ids = [
                (await asyncio.wait_for(reader.get_message(), TIMEOUT_S)).arbitration_id for _ in range(500)
            ]
            notifier.stop()
            sender.close()
        return ids

    assert asyncio.run(listen()) == list(range(500))


def test_what_the_bus_cannot_do_is_refused_with_the_reason(local: ProvidedBus) -> None:
    with can.Bus(path_of(local), "vibrohil") as bus, pytest.raises(can.CanOperationError, match="no CAN FD"):
        bus.send(can.Message(is_fd=True, data=bytes(12)))


@pytest.mark.parametrize("channel", [None, 0, 1.5, ("a", "b")])
def test_a_channel_that_is_no_path_is_refused_with_what_is_wanted(channel: Any) -> None:
    with pytest.raises(can.CanInitializationError, match="path that a running"):
        can.Bus(channel, "vibrohil")


def test_a_path_object_and_the_whole_address_are_channels(local: ProvidedBus) -> None:
    for channel in (Path(path_of(local)), local.address):
        can.Bus(channel, "vibrohil").shutdown()


def test_recv_and_send_report_the_end_of_the_bus(local: ProvidedBus) -> None:
    assert local.holder is not None
    with can.Bus(path_of(local), "vibrohil") as bus, can.Bus(path_of(local), "vibrohil") as other:
        other.send(STANDARD)
        assert bus.recv(TIMEOUT_S) is not None
        os.kill(local.holder.pid, signal.SIGKILL)
        assert local.holder.wait(TIMEOUT_S)
        with pytest.raises(can.CanOperationError, match="hub has ended"):
            bus.recv(TIMEOUT_S)
        with pytest.raises(can.CanOperationError, match="hub has ended"):
            other.send(STANDARD)
        with pytest.raises(can.CanOperationError, match="hub has ended"):
            bus.recv(0)


def test_a_lost_message_raises_nothing_but_is_counted(local: ProvidedBus) -> None:
    """As on SocketCAN: whoever sleeps loses messages and goes on."""
    sender = join(local.address)
    with can.Bus(path_of(local), "vibrohil") as bus:
        for _ in range(600):
            sender.send_all([Frame(1, bytes(8))] * 200)
            time.sleep(0.001)
        received = 0
        while bus.recv(0.2) is not None:
            received += 1
        assert bus.lost == 120_000 - received > 0  # type: ignore[attr-defined]  # python-can has no name for it
    sender.close()


def test_remote_frames_that_a_node_asked_for_arrive_as_empty_ones(
    local: ProvidedBus,
) -> None:
    asking = join(local.address, accept=[0x001, 0x001 | REMOTE_FLAG])
    with can.Bus(path_of(local), "vibrohil") as client:
        for can_id in (0x002, 0x001):
            client.send(can.Message(arbitration_id=can_id, is_extended_id=False, is_remote_frame=True, dlc=8))
        assert frames_within(asking, 1) == [Frame(0x001, b"")]
    assert asking.counters.foreign == 1
    asking.close()
