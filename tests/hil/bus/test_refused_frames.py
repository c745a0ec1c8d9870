"""A device that refuses frames for 0.3 s, for ever, and again, on each transmit path: counted and reported.

A node sends one frame each millisecond; which of them are refused is counted, not timed.
"""

import ctypes
import errno
import json
import select
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from made_adapters import REFUSING, installed
from resting import resting
from test_adapters import address, vibrohil

from firmware_py.interface.frame import Frame
from hil.bus import Bus, ProvidedBus, join, open_bus, provide
from hil.bus.base import WrappedBus
from hil.bus.can_socket import CanSocket
from hil.bus.model.modelled_bus import ModelledBus
from hil.processes.child import READY_TIMEOUT_S
from tools.output import EXIT_BAD_INPUT, EXIT_NOTHING_RAN

SENT = 1000
MANNERS = {name: kind.refused for name, kind in REFUSING.items()}


@pytest.fixture
def wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ProvidedBus]:
    """The hub that the made adapters are connected to."""
    (tmp_path / "adapters").mkdir()
    installed(tmp_path / "adapters", monkeypatch)
    with provide("local") as provided:
        yield provided


class Device:
    """What the transmit paths below ask before each frame."""

    def __init__(self, refused: Sequence[int]) -> None:
        self.refused = refused
        self.number = 0

    @property
    def is_full(self) -> bool:
        return self.number in self.refused


@contextmanager
def on_hub(_: str, wire: ProvidedBus, device: Device) -> Iterator[Bus]:
    """A node whose stream to the hub has no room while the device is full."""
    with closing(join(wire.address)) as node:
        stream = node._socket  # type: ignore[attr-defined]

        def send(packed: bytes) -> int:
            if device.is_full:
                raise BlockingIOError
            wait_for_room(stream)
            return int(stream.send(packed))

        node._socket = SimpleNamespace(send=send, close=stream.close)  # type: ignore[attr-defined]
        yield node


@contextmanager
def on_kernel_can(_: str, __: ProvidedBus, device: Device) -> Iterator[Bus]:
    """A node on a socket that is used as one of kernel CAN, whose queue is full while the device is."""
    receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiving.bind(("127.0.0.1", 0))
    sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sending.connect(receiving.getsockname())
    with receiving, closing(CanSocket(sending)) as node:
        send_batch = node._send_batch

        def send(*arguments: Any) -> int:
            if device.is_full:
                ctypes.set_errno(errno.ENOBUFS)
                return -1
            return int(send_batch(*arguments))

        node._send_batch = send
        yield node


def wait_for_room(stream: Any) -> None:
    """Wait until a stream to the hub has room, however late the process is that reads it."""
    assert select.select([], [stream], [], READY_TIMEOUT_S)[1], "the hub reads nothing"


class WithRoom(WrappedBus):
    """A bus that sends once its stream has room."""

    def send_all(self, frames: Iterable[Frame]) -> None:
        wait_for_room(self.inner)
        self.inner.send_all(frames)


@contextmanager
def on_adapter(kind: str, wire: ProvidedBus, _: Device) -> Iterator[Bus]:
    """A node on a made adapter, which itself counts and refuses; its own stream refuses nothing."""
    with open_bus(address(kind, wire)) as (_, node):
        yield WithRoom(node)


@pytest.mark.parametrize("kind", MANNERS)
@pytest.mark.parametrize("opened", [on_hub, on_kernel_can, on_adapter])
def test_refused_frames_are_counted_and_the_first_is_reported(
    opened: Callable[..., Any], kind: str, wire: ProvidedBus, caplog: pytest.LogCaptureFixture
) -> None:
    device = Device(MANNERS[kind])
    with opened(kind, wire, device) as node:
        for device.number in range(SENT):
            node.send_all([Frame(1, b"")])
    counters, refused = node.counters, sum(number in MANNERS[kind] for number in range(SENT))
    assert (counters.sent, counters.unsent) == (SENT, refused)
    assert counters.first_unsent_ns is not None
    assert "full" in counters.refusal or "No buffer space" in counters.refusal
    assert len([record for record in caplog.records if "refused" in record.message]) == 1


@pytest.mark.parametrize("kind", MANNERS)
def test_frames_that_a_modelled_node_cannot_send_are_counted(kind: str) -> None:
    """In lockstep it is held bus-off, and recovers within two milliseconds."""
    off = MANNERS[kind]
    bus = ModelledBus(("sender", "receiver"))
    sender, receiver = bus.join("sender"), bus.join("receiver")
    for tick in range(SENT):
        bus.move_to(tick * 1_000_000)
        if tick in off:
            bus.switch_off("sender")
        sender.send_all([Frame(1, b"")])
    bus.move_to(SENT * 1_000_000)
    refused = sum(tick in off for tick in range(SENT))
    assert refused <= sender.lost <= refused + 4
    assert len(receiver.receive()) + sender.lost == SENT


@pytest.mark.realtime
@pytest.mark.parametrize("kind", MANNERS)
def test_a_node_alone_counts_what_its_adapter_refuses(kind: str, wire: ProvidedBus) -> None:
    program = vibrohil("plant", "soft-start-multistable", "--bus", address(kind, wire), "--until", "0.5")
    _, errors = program.communicate()
    assert program.returncode == 0, errors
    summary = json.loads(next(line for line in errors.splitlines() if line.startswith("{")))
    refused = sum(number in MANNERS[kind] for number in range(summary["sent"]))
    assert summary["unsent"] == refused > 0
    assert errors.count("frames are refused and not sent: ") == 1
    assert f"{refused} frames were refused and not sent" in errors


@pytest.mark.realtime
def test_a_node_alone_ends_when_its_adapter_refuses_for_ever(wire: ProvidedBus) -> None:
    """Not before it has carried a frame: until another node is on the bus, a real one carries none."""
    program = vibrohil("plant", "soft-start-multistable", "--bus", address("made-refusing-for-ever", wire))
    _, errors = program.communicate(timeout=READY_TIMEOUT_S)
    assert program.returncode == EXIT_BAD_INPUT
    assert "error: the adapter has failed: " in errors
    assert "it has refused every frame for 1." in errors
    waiting = vibrohil(
        *("plant", "soft-start-multistable", "--bus", address("made-not-yet", wire), "--until", "1.5")
    )
    _, errors = waiting.communicate()
    assert waiting.returncode == 0, errors


@pytest.mark.parametrize("opened", [on_hub, on_kernel_can])
def test_a_bus_that_refuses_for_a_second_has_failed_if_it_carried_frames(
    opened: Callable[..., Any], wire: ProvidedBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = [0]
    monkeypatch.setattr("hil.bus.base.time.monotonic_ns", lambda: now_ns[0])
    device = Device(REFUSING["made-refusing-again"].refused)
    failed = []
    with opened("", wire, device) as node:
        for device.number in range(340):
            node.send_all([Frame(1, b"")])
            now_ns[0] += 4_000_000
            failed += [device.number] if node.failure else []
    assert failed == list(range(20 + 250, 340)), "from one second on, and for good"


@pytest.mark.realtime
def test_a_run_whose_frames_are_refused_is_not_judged(wire: ProvidedBus, tmp_path: Path) -> None:
    bus = address("made-refusing-for-300-ms", wire)
    out = tmp_path / "run"
    program = vibrohil(
        *("run", str(resting(tmp_path, duration_s=0.5)), "--clock", "real", "--bus", bus),
        *("--out", str(out), "--json"),
    )
    printed, errors = program.communicate()
    verdict = json.loads(printed)
    assert program.returncode == EXIT_NOTHING_RAN, errors
    assert verdict["log"]["frames_unsent"] == 300
    (reason,) = [one for one in verdict["not_judged"] if "refused" in one]
    assert reason.startswith("the bus refused 300 frames of the run's nodes, the first at 0.0")
    assert reason.endswith("the transmit buffer is full")
