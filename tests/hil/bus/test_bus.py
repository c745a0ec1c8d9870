"""Buses: who receives from whom, what is never lost, and what happens when nobody reads."""

import contextlib
import errno
import os
import select
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from kernel_interface import needs_kernel_can
from waiting import frames_within

from firmware_py.interface.frame import Frame
from hil.bus import Bus, BusError, ProvidedBus, join, open_bus, provide
from hil.bus.base import MAX_BURST
from hil.bus.can_socket import BATCH, SO_TIMESTAMPNS, CanSocket, fetch_can_socket, has_kernel_can
from hil.bus.hub_socket import HELLO
from hil.bus.in_process import InProcessBus
from hil.bus.vcan import hand_out
from hil.bus.wire import CAN_FRAME
from hil.processes.child import Child
from hil.processes.signals import Interrupted


def frame(number: int) -> Frame:
    """A frame that carries its number."""
    return Frame(0x100 + number % 0x100, number.to_bytes(4, "little"))


@pytest.fixture
def local() -> Iterator[ProvidedBus]:
    with provide("local") as provided:
        yield provided


@pytest.fixture(scope="module", params=["local", pytest.param("vcan", marks=needs_kernel_can)])
def either(request: pytest.FixtureRequest) -> Iterator[ProvidedBus]:
    """The hub, and the kernel's own bus; each test joins it with nodes of its own."""
    with provide(request.param) as provided:
        yield provided


@contextlib.contextmanager
def joined(provided: ProvidedBus, count: int, stamped: bool = False) -> Iterator[list[Bus]]:
    nodes = [join(provided.address, stamped=stamped) for _ in range(count)]
    try:
        yield nodes
    finally:
        for node in nodes:
            node.close()


def test_frames_reach_all_others_unchanged_and_never_their_sender(either: ProvidedBus) -> None:
    frames = [Frame(0x7FF, b""), Frame(0, b"\0" * 8), Frame(0x123, b"\x01\x02\x03")]
    with joined(either, 3) as (first, second, third):
        first.send(frames[0])
        first.send_all(frames[1:])
        assert frames_within(second, 3) == frames
        assert frames_within(third, 3) == frames
        assert first.receive() == []


def test_two_buses_never_receive_from_each_other(either: ProvidedBus) -> None:
    with provide(either.name) as other, joined(either, 2) as (a, b), joined(other, 2) as (c, d):
        a.send(frame(1))
        c.send(frame(2))
        assert frames_within(b, 1) == [frame(1)]
        assert frames_within(d, 1) == [frame(2)]
        time.sleep(0.05)
        assert [bus.receive() for bus in (a, b, c, d)] == [[], [], [], []]


def test_bus_is_reachable_by_its_own_user_alone_and_leaves_nothing() -> None:
    with provide("local") as provided:
        folder = Path(provided.address.removeprefix("local:")).parent
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert folder.stat().st_uid == os.getuid()
    assert not folder.exists()


def test_a_thousand_frames_at_once_arrive_whole_and_in_order(either: ProvidedBus) -> None:
    with joined(either, 2) as (sender, reader):
        sender.send_all([frame(number) for number in range(1000)])
        assert frames_within(reader, 1000) == [frame(number) for number in range(1000)]
        assert sender.counters.unsent == 0


@contextlib.contextmanager
def held_up(local: ProvidedBus) -> Iterator[None]:
    """The hub is stopped meanwhile."""
    assert local.holder is not None
    os.kill(local.holder.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(local.holder.pid, signal.SIGCONT)


def test_hundred_single_frames_wait_for_a_hub_that_is_held_up(local: ProvidedBus) -> None:
    hundred = [frame(number) for number in range(100)]
    with joined(local, 2) as (sender, reader):
        with held_up(local):
            for one in hundred:
                sender.send(one)
        assert frames_within(reader, 100) == hundred
        assert sender.counters.waited == sender.counters.unsent == 0


def test_a_node_that_does_not_read_counts_its_losses_and_costs_the_others_nothing(local: ProvidedBus) -> None:
    with joined(local, 3) as (sender, reader, plain), joined(local, 1, stamped=True) as (stamped,):
        for start in range(0, 100_000, 500):
            burst = [frame(number) for number in range(start, start + 500)]
            sender.send_all(burst)
            assert frames_within(reader, 500) == burst
        assert sender.counters.unsent == 0
        for asleep, receive in ((plain, plain.receive), (stamped, stamped.receive_stamped)):
            arrived = 0
            while select.select([asleep], [], [], 0.3)[0]:
                arrived += len(receive())
            assert asleep.counters.lost == 100_000 - arrived > 0
            assert asleep.counters.foreign == 0
    local.close()
    assert '"forwarded": 100000' in local.said
    assert '"dropped": 0' not in local.said


def datagrams() -> tuple[socket.socket, socket.socket]:
    """A socket with a short queue and one that sends to it: the kernel counts drops of any datagram alike."""
    receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiving.bind(("127.0.0.1", 0))
    receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    receiving.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sending.connect(receiving.getsockname())
    return receiving, sending


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's counts are Linux's")
def test_frames_lost_by_the_kernel_are_counted_and_the_others_are_stamped() -> None:
    receiving, sending = datagrams()
    bus = CanSocket(receiving)
    with sending:
        began_ns = time.time_ns()
        for number in range(100):
            sending.send(CAN_FRAME.pack(number, 1, b"x"))
        frames = bus.receive_stamped()
        assert bus.receive_stamped() == []
        assert bus.counters.lost == 100 - len(frames) > 0
        stamps_ns = [stamp_ns for stamp_ns, _ in frames]
        assert began_ns <= stamps_ns[0]
        assert stamps_ns == sorted(stamps_ns)
        assert stamps_ns[-1] <= time.time_ns()
        bus.close()


def test_full_transmit_queue_is_waited_for_shortly_then_counted(local: ProvidedBus) -> None:
    with joined(local, 1) as (sender,), held_up(local):
        longest_s = 0.0
        while sender.counters.unsent < 20:
            started = time.monotonic()
            sender.send(frame(1))
            longest_s = max(longest_s, time.monotonic() - started)
        assert sender.counters.waited == sender.counters.unsent == 20
        assert longest_s < 0.1


def test_stream_stays_in_step_after_a_full_queue(local: ProvidedBus) -> None:
    with joined(local, 2) as (sender, reader):
        with held_up(local):
            while sender.counters.unsent == 0:
                sender.send_all([frame(number) for number in range(3000)])
        while frames_within(reader, 1, timeout_s=0.3):
            pass
        sender.send(frame(77))
        assert frames_within(reader, 1)[-1] == frame(77)
        assert reader.counters.foreign == 0


def test_arrivals_carry_the_wall_clock_where_asked_for(either: ProvidedBus) -> None:
    with joined(either, 1) as (sender,), joined(either, 1, stamped=True) as (recorder,):
        before_ns = time.time_ns()
        sender.send_all([frame(1), frame(2)])
        stamped: list[tuple[int, Frame]] = []
        while len(stamped) < 2 and time.time_ns() < before_ns + 2_000_000_000:
            recorder.wait(0.1)
            stamped += recorder.receive_stamped()
        assert [received for _, received in stamped] == [frame(1), frame(2)]
        assert all(before_ns <= stamp_ns <= time.time_ns() for stamp_ns, _ in stamped)


def test_stamped_frames_behind_many_foreign_messages_are_received_in_the_same_call(
    local: ProvidedBus,
) -> None:
    """Else a recorder that is asked to end takes the bus for empty."""
    with joined(local, 1) as (sender,), joined(local, 1, stamped=True) as (recorder,):
        for _ in range(3):
            sender.send_all([Frame(0x80000001, b"")] * (MAX_BURST // 2))
            time.sleep(0.05)
        sender.send(frame(1))
        time.sleep(0.1)
        assert [received for _, received in recorder.receive_stamped()] == [frame(1)]
        assert recorder.counters.foreign == 3 * (MAX_BURST // 2)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's time stamps are Linux's")
def test_datagrams_behind_many_foreign_ones_are_received_in_the_same_call() -> None:
    receiving, sending = datagrams()
    receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    bus = CanSocket(receiving)
    with sending, contextlib.closing(bus):
        for _ in range(BATCH):  # datagrams take much room
            sending.send(CAN_FRAME.pack(0x80000001, 0, b""))
        sending.send(CAN_FRAME.pack(1, 1, b"x"))
        assert [received for _, received in bus.receive_stamped()] == [Frame(1, b"x")]


def test_frames_stamped_later_than_wanted_are_left_for_the_next_call(local: ProvidedBus) -> None:
    """However fast others send, a call comes to its end."""
    with joined(local, 1) as (sender,), joined(local, 1, stamped=True) as (recorder,):
        sender.send(frame(1))
        recorder.wait(2.0)
        assert len(recorder.receive_stamped(time.time_ns())) == 1
        sender.send(frame(2))
        recorder.wait(2.0)
        assert recorder.receive_stamped(0) == []
        assert [received for _, received in recorder.receive_stamped()] == [frame(2)]


def test_a_holder_of_sockets_does_not_wait_for_a_client_that_takes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that was stopped while it joined; the others join meanwhile."""
    monkeypatch.setattr("hil.bus.vcan.new_can_socket", lambda: socket.socket(socket.AF_UNIX))
    with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as client:
        listener.bind(str(tmp_path / "vcan"))
        listener.listen()
        client.connect(str(tmp_path / "vcan"))
        serving = Thread(target=hand_out, args=(listener,), daemon=True)
        serving.start()
        serving.join(2.0)
        assert not serving.is_alive()


def test_a_holder_of_sockets_outlives_a_client_that_has_ended_before_its_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the bus of all others would end with it."""
    monkeypatch.setattr("hil.bus.vcan.new_can_socket", lambda: socket.socket(socket.AF_UNIX))
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "vcan"))
        listener.listen()
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(tmp_path / "vcan"))
        hand_out(listener)


def test_a_node_does_not_wait_for_a_holder_that_answers_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.bus.can_socket.ANSWER_TIMEOUT_S", 0.05)
    failed: list[BusError] = []

    def fetch() -> None:
        try:
            fetch_can_socket(tmp_path / "vcan")
        except BusError as error:
            failed.append(error)

    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "vcan"))
        listener.listen()
        joining = Thread(target=fetch, daemon=True)
        joining.start()
        joining.join(2.0)
        assert "no private vcan is held" in str(failed)


def test_a_private_vcan_that_is_gone_when_its_socket_is_bound_is_an_error_of_the_bus(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its holder has ended after it gave the socket."""

    class Unbound(socket.socket):
        def bind(self, _: object) -> None:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    monkeypatch.setattr("hil.bus.opening.fetch_can_socket", lambda _: Unbound(socket.AF_UNIX))
    with pytest.raises(BusError, match=r"bus vcan:/gone/vcan did not open: .*No such device"):
        join("vcan:/gone/vcan")


def test_a_foreign_program_is_disconnected_and_the_others_receive_nothing_of_it(local: ProvidedBus) -> None:
    with joined(local, 1) as (node,), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as stranger:
        stranger.connect(local.address.removeprefix("local:"))
        stranger.sendall(CAN_FRAME.pack(0x123, 8, b"intruder"))
        stranger.settimeout(2.0)
        assert stranger.recv(16) == b""
        assert node.receive() == []


def test_frames_with_flags_are_counted_not_delivered(local: ProvidedBus) -> None:
    with joined(local, 1) as (node,), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.connect(local.address.removeprefix("local:"))
        other.sendall(HELLO + CAN_FRAME.pack(0x80000123, 8, b"extended") + CAN_FRAME.pack(0x123, 2, b"ok"))
        assert frames_within(node, 1) == [Frame(0x123, b"ok")]
        assert node.counters.foreign == 1


def test_hub_that_dies_leaves_nodes_that_count(local: ProvidedBus) -> None:
    assert local.holder is not None
    with joined(local, 1) as (node,):
        os.kill(local.holder.pid, signal.SIGKILL)
        assert local.holder.wait(2.0)
        assert local.holder.how_it_ended() == "hub was killed by SIGKILL"
        for _ in range(3):
            node.send(frame(1))
            assert node.receive() == []
        assert node.counters.unsent >= 2


PROVIDE_AND_DIE = """
import os, signal
from hil.bus import provide
provided = provide("local")
print(provided.holder.pid, provided.address, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_an_interruption_while_the_hub_starts_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []

    def interrupted(child: Child, _: float) -> str:
        started.append(child.pid)
        raise Interrupted("interrupted by Ctrl-C")

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(Child, "read_line", interrupted)
    with pytest.raises(Interrupted):
        provide("local")
    (pid,) = started
    assert not Path(f"/proc/{pid}").exists()
    assert list(tmp_path.iterdir()) == []


def test_hub_ends_with_a_killed_parent_and_cleans_up() -> None:
    killed = subprocess.run(
        [sys.executable, "-c", PROVIDE_AND_DIE], capture_output=True, text=True, check=False
    )
    assert killed.stderr == ""
    pid, address = killed.stdout.split()
    deadline = time.monotonic() + 3.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not Path(f"/proc/{pid}").exists()
    assert not Path(address.removeprefix("local:")).parent.exists()


def test_open_bus_makes_a_bus_that_ends_with_its_node() -> None:
    with open_bus("local") as (provided, node):
        node.send(frame(1))
        socket = Path(provided.address.removeprefix("local:"))
        assert socket.exists()
    assert not socket.parent.exists()


def test_in_process_nodes_receive_from_the_others_only() -> None:
    bus = InProcessBus()
    first, second, third = bus.join(), bus.join(), bus.join()
    first.send_all([frame(1)])
    second.send_all([frame(2), frame(3)])
    assert first.receive() == [frame(2), frame(3)]
    assert second.receive() == [frame(1)]
    assert third.receive() == [frame(1), frame(2), frame(3)]
    assert third.receive() == []


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("nonsense", "wanted auto, vcan, local"),
        ("nosuch:can0", "Unknown interface type"),
        ("local:/nowhere/bus", "no hub answers at local:/nowhere/bus"),
        ("vcan:/nowhere/vcan", "no private vcan is held"),
    ],
)
def test_bus_that_cannot_be_opened_says_what_was_wanted(spec: str, message: str) -> None:
    with pytest.raises(BusError, match=message), open_bus(spec):
        pass


@pytest.mark.parametrize("spec", ["local:/nowhere/bus", "vcan:/nowhere/vcan", "socketcan:nowhere0"])
def test_a_bus_that_is_not_there_is_reported_before_any_process_starts(spec: str) -> None:
    with pytest.raises(BusError, match="nowhere"):
        provide(spec)


@pytest.mark.skipif(has_kernel_can(), reason="the kernel has CAN")
def test_without_kernel_can_auto_takes_local_and_says_why() -> None:
    with pytest.raises(BusError, match="this kernel has no CAN sockets"):
        provide("vcan")
    with provide("auto") as provided:
        assert provided.name == "local"
        assert not provided.kernel_can
        assert "no CAN sockets" in provided.reason


def test_a_run_records_no_path_of_its_private_bus(tmp_path):
    private = ProvidedBus("local", f"local:{tmp_path}/hub", False, "no other bus", folder=tmp_path)
    assert str(tmp_path) not in str(private.described)
    adapter = ProvidedBus("socketcan:can0", "socketcan:can0", True, "asked for")
    assert adapter.described["bus_address"] == "socketcan:can0"
