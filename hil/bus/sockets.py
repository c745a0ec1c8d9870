"""The lean nodes' sockets: kernel CAN, and the hub that stands in for it.

Both carry Linux's `struct can_frame`, 16 bytes: identifier (with flags in its top bits), length, padding,
eight data bytes. A kernel CAN socket takes and gives one frame a call; the hub's is a stream of frames, so
that one call moves all of a tick.
"""

import errno
import socket
import struct
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST, SEND_RETRIES, SEND_RETRY_S, BusCounters, BusError

CAN_FRAME = struct.Struct("=IB3x8s")
FRAME_BYTES = CAN_FRAME.size
MAX_STANDARD_ID = 0x7FF
EXACT_ID_MASK = 0xC0000000 | MAX_STANDARD_ID
"""A kernel filter's mask: the identifier, and neither the extended nor the remote flag."""

CONTROL_ID = 0xFFFFFFFF
"""Marks what passes between hub and node beside frames; no CAN frame can carry it."""
HELLO = CAN_FRAME.pack(CONTROL_ID, 0, b"vibro-1\0")
HELLO_STAMPED = CAN_FRAME.pack(CONTROL_ID, 1, b"vibro-1\0")

JOIN_TIMEOUT_S = 5.0
SO_TIMESTAMPNS = 35
"""Linux's `SO_TIMESTAMPNS_OLD` on a 64-bit machine: each frame with the wall clock of its arrival."""
TIMESPEC = struct.Struct("=qq")
STAMP_SPACE = socket.CMSG_SPACE(TIMESPEC.size)

RECEIVE_BUFFER_BYTES = 1 << 20
QUEUE_FULL = (errno.EAGAIN, errno.ENOBUFS)
NOTHING_TO_RECEIVE = (errno.EAGAIN, errno.ENETDOWN, errno.ENODEV)


def pack(frames: Iterable[Frame]) -> bytes:
    """The frames as `struct can_frame`s, one after another."""
    return b"".join([CAN_FRAME.pack(can_id, len(data), data) for can_id, data in frames])


def unpack(chunk: bytes, counters: BusCounters) -> list[Frame]:
    """The data frames among the `struct can_frame`s of `chunk`; others are counted as foreign."""
    frames = [
        Frame(can_id, data[:length])
        for can_id, length, data in CAN_FRAME.iter_unpack(chunk)
        if can_id <= MAX_STANDARD_ID
    ]
    counters.foreign += len(chunk) // FRAME_BYTES - len(frames)
    return frames


class HubSocket:
    """A node on the bus `local`: a stream socket to the hub."""

    def __init__(self, path: Path, stamped: bool = False) -> None:
        self.counters = BusCounters()
        self.closing: list[Callable[[], None]] = []
        self._received = b""
        self._unfinished = b""
        self._stamp_ns = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(JOIN_TIMEOUT_S)
        try:
            self._socket.connect(str(path))
            self._socket.sendall(HELLO_STAMPED if stamped else HELLO)
            answer = self._socket.recv(FRAME_BYTES, socket.MSG_WAITALL)
        except OSError as error:
            self._socket.close()
            raise BusError(
                f"no hub answers at local:{path} ({error}); wanted the address that a running "
                "`vibrohil run` or `vibrohil plant --bus local` prints"
            ) from error
        if answer != HELLO:
            self._socket.close()
            raise BusError(f"what listens at local:{path} is no hub of this version: it said {answer!r}")
        self._socket.setblocking(False)

    def send(self, frame: Frame) -> None:
        """Queue one frame."""
        self._write(CAN_FRAME.pack(frame[0], len(frame[1]), frame[1]))

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in one system call."""
        if packed := pack(frames):
            self._write(packed)

    def _write(self, packed: bytes) -> None:
        if self._unfinished:
            packed = self._unfinished + packed
        for attempt in range(SEND_RETRIES + 1):
            if attempt:
                self.counters.waited += attempt == 1
                time.sleep(SEND_RETRY_S)
            try:
                sent = self._socket.send(packed)
            except BlockingIOError:
                continue
            except ConnectionError:
                break
            if sent == len(packed):
                self._unfinished = b""
                return
            packed = packed[sent:]
        # What is left of a frame that went out in part goes first next time: the stream stays in step.
        self._unfinished = packed[: len(packed) % FRAME_BYTES]
        self.counters.unsent += len(packed) // FRAME_BYTES

    def _read(self) -> bytes:
        """All whole frames that have arrived."""
        try:
            chunk = self._socket.recv(MAX_BURST * FRAME_BYTES)
        except (BlockingIOError, ConnectionError):
            return b""
        if self._received or len(chunk) % FRAME_BYTES:
            chunk = self._received + chunk
            whole = len(chunk) - len(chunk) % FRAME_BYTES
            chunk, self._received = chunk[:whole], chunk[whole:]
        return chunk

    def receive(self) -> list[Frame]:
        """All frames that have arrived."""
        return unpack(self._read(), self.counters)

    def receive_stamped(self) -> list[tuple[int, Frame]]:
        """All frames that have arrived, with the hub's wall clock in ns when it passed each on."""
        frames = []
        for can_id, length, data in CAN_FRAME.iter_unpack(self._read()):
            if can_id == CONTROL_ID:
                self._stamp_ns = int.from_bytes(data, "little")
            elif can_id <= MAX_STANDARD_ID:
                frames.append((self._stamp_ns, Frame(can_id, data[:length])))
            else:
                self.counters.foreign += 1
        return frames

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._socket.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()
        for close in self.closing:
            close()


def open_can_socket(interface: str, accept: Iterable[int] | None, stamped: bool) -> socket.socket:
    """A kernel CAN socket on `interface` that receives the identifiers of `accept`, or all."""
    can_socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    if accept is not None:
        filters = b"".join(struct.pack("=II", can_id, EXACT_ID_MASK) for can_id in accept)
        can_socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
    if stamped:
        can_socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    can_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    can_socket.bind((interface,))
    return can_socket


class CanSocket:
    """A node on a kernel CAN interface: one frame a system call, no select, no clock."""

    def __init__(self, can_socket: socket.socket) -> None:
        self.counters = BusCounters()
        self.closing: list[Callable[[], None]] = []
        self._socket = can_socket
        self._socket.setblocking(False)

    def send(self, frame: Frame) -> None:
        """Queue one frame."""
        packed = CAN_FRAME.pack(frame[0], len(frame[1]), frame[1])
        for attempt in range(SEND_RETRIES + 1):
            if attempt:
                self.counters.waited += attempt == 1
                time.sleep(SEND_RETRY_S)
            try:
                self._socket.send(packed)
            except OSError as error:
                if error.errno not in QUEUE_FULL:
                    break  # unplugged or down: counted, and the watchdogs at both ends do the rest
            else:
                return
        self.counters.unsent += 1

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order."""
        for frame in frames:
            self.send(frame)

    def receive(self) -> list[Frame]:
        """All frames that have arrived."""
        receive = self._socket.recv
        chunks = []
        try:
            for _ in range(MAX_BURST):
                chunks.append(receive(FRAME_BYTES))
        except OSError as error:
            self._raise_unless_expected(error)
        return unpack(b"".join(chunks), self.counters)

    def receive_stamped(self) -> list[tuple[int, Frame]]:
        """All frames that have arrived, with the kernel's wall clock in ns."""
        frames = []
        try:
            for _ in range(MAX_BURST):
                chunk, ancillary, _, _ = self._socket.recvmsg(FRAME_BYTES, STAMP_SPACE)
                stamp_ns = 0
                for level, kind, content in ancillary:
                    if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
                        seconds, nanoseconds = TIMESPEC.unpack(content[: TIMESPEC.size])
                        stamp_ns = seconds * 1_000_000_000 + nanoseconds
                frames += [(stamp_ns, frame) for frame in unpack(chunk, self.counters)]
        except OSError as error:
            self._raise_unless_expected(error)
        return frames

    @staticmethod
    def _raise_unless_expected(error: OSError) -> None:
        """An empty queue ends a read, and so does an interface that went down; anything else is a defect."""
        if error.errno not in NOTHING_TO_RECEIVE:
            raise error

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._socket.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()
        for close in self.closing:
            close()
