"""A node on a kernel CAN interface: frames are sent and received in batches.

One `recvmmsg` receives all frames that have arrived and one `sendmmsg` sends all frames of a tick. Python's
own socket calls move one frame each; under user-mode Linux, where a system call costs 12 µs, they would take
half of a tick's work.
"""

import ctypes
import errno
import os
import socket
import struct
import time
from collections.abc import Iterable
from pathlib import Path

from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST, NO_END_NS, SEND_RETRIES, SEND_RETRY_S, BusCounters, BusError, Connection
from hil.bus.wire import FRAME_BYTES, MAX_STANDARD_ID, pack, unpack
from hil.timing.clock import NS_PER_S
from hil.timing.realtime import libc

PRIVATE_INTERFACE = "vcan0"
"""The interface of a private vcan, in a network namespace where it is the only one beside `lo`."""
ANSWER_TIMEOUT_S = 60.0
"""Longest wait for a socket of another network namespace, whose holder may wait for a busy machine."""
BATCH = 256
"""Largest number of frames per system call: a quarter of a second of traffic on this bus."""
EXACT_ID_MASK = 0xC0000000 | MAX_STANDARD_ID
"""Mask of a kernel filter: compares the identifier and the flags for extended and remote frames."""

# Constants of Linux that Python's socket module lacks.
SO_RCVBUFFORCE = 33
SO_TIMESTAMPNS = 35
SO_MEMINFO = 55
MEMINFO = struct.Struct("=9I")
"""Counters that SO_MEMINFO returns; the last one counts dropped messages."""
STAMP = struct.Struct("=qQ")
"""A time: seconds and nanoseconds."""

RECEIVE_BUFFER_BYTES = 4 << 20
QUEUE_FULL = (errno.EAGAIN, errno.ENOBUFS)
GONE = (errno.ENODEV, errno.ENXIO)
"""Errors of an interface that was removed, as by pulling its plug; it never comes back to this socket."""
NOTHING_TO_RECEIVE = (errno.EAGAIN, errno.ENETDOWN, *GONE)
"""Errors that mean an empty queue, or an interface that went down or is gone; any other error is raised."""


class IoVector(ctypes.Structure):
    """`struct iovec`."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class MessageHeader(ctypes.Structure):
    """`struct msghdr`."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint),
        ("vectors", ctypes.POINTER(IoVector)),
        ("vector_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class BatchHeader(ctypes.Structure):
    """`struct mmsghdr`: a message and its transferred length."""

    _fields_ = (("message", MessageHeader), ("length", ctypes.c_uint))


class FrameBatch:
    """Buffers for a batch of frames, and their headers."""

    def __init__(self) -> None:
        self.buffer = bytearray(BATCH * FRAME_BYTES)
        address = ctypes.addressof(ctypes.c_char.from_buffer(self.buffer))
        self._vectors = (IoVector * BATCH)(
            *(IoVector(address + index * FRAME_BYTES, FRAME_BYTES) for index in range(BATCH))
        )
        self.headers = (BatchHeader * BATCH)()
        for header, vector in zip(self.headers, self._vectors, strict=True):
            header.message.vectors = ctypes.pointer(vector)
            header.message.vector_count = 1


def has_kernel_can() -> bool:
    """Whether the kernel supports CAN sockets."""
    if not hasattr(socket, "AF_CAN"):
        return False
    try:
        new_can_socket().close()
    except OSError:
        return False
    return True


def new_can_socket() -> socket.socket:
    """Make a kernel CAN socket in the network namespace of this process, bound to no interface."""
    return socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)


def bind_can_socket(
    can_socket: socket.socket, interface: str, accept: Iterable[int] | None, stamped: bool
) -> socket.socket:
    """Bind a socket to `interface` for the identifiers in `accept`, or for all if it is None."""
    if accept is not None:
        filters = b"".join(struct.pack("=II", can_id, EXACT_ID_MASK) for can_id in accept)
        can_socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
    if stamped:
        can_socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    try:
        can_socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
    except PermissionError:
        can_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    try:
        can_socket.bind((interface,))
    except OSError:
        can_socket.close()
        raise
    return can_socket


def fetch_can_socket(path: Path) -> socket.socket:
    """Return an unbound CAN socket of another network namespace from the process that listens at `path`."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(ANSWER_TIMEOUT_S)
        try:
            link.connect(str(path))
            _, descriptors, _, _ = socket.recv_fds(link, 1, 1)
        except OSError as error:
            raise BusError(
                f"no private vcan is held at vcan:{path} ({error}); wanted the address that a running "
                "`vibrohil run --bus vcan` prints"
            ) from error
    if not descriptors:
        raise BusError(f"the holder of vcan:{path} gave no CAN socket; it may be shutting down")
    return socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW, descriptors[0])


class CanSocket(Connection):
    """A node's bus over a raw CAN socket that is open and bound."""

    def __init__(self, can_socket: socket.socket, requests: frozenset[int] = frozenset()) -> None:
        library = libc()
        assert library is not None, "kernel CAN is Linux's"
        self._counters = BusCounters()
        self._requests = requests
        self._socket = can_socket
        self._descriptor = can_socket.fileno()
        self._receive_batch = library.recvmmsg
        self._send_batch = library.sendmmsg
        self._incoming = FrameBatch()
        self.newest_ns = 0
        self.failure = ""
        """Why the bus carries no more frames; empty while it works."""
        self._outgoing = FrameBatch()

    @property
    def counters(self) -> BusCounters:
        """The errors counted so far, or up to `close`."""
        if self._socket.fileno() >= 0:
            self._counters.lost = self._drops()
        return self._counters

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in one system call for each batch."""
        packed = pack(frames)
        self._counters.sent += len(packed) // FRAME_BYTES
        for start in range(0, len(packed), BATCH * FRAME_BYTES):
            self._write(packed[start : start + BATCH * FRAME_BYTES])

    def _write(self, packed: bytes) -> None:
        attempt = 0
        while packed:
            self._outgoing.buffer[: len(packed)] = packed
            count = len(packed) // FRAME_BYTES
            sent = self._send_batch(self._descriptor, self._outgoing.headers, count, socket.MSG_DONTWAIT)
            if sent == count:
                return
            if sent > 0:
                packed = packed[sent * FRAME_BYTES :]
                continue
            number = ctypes.get_errno()
            if number not in QUEUE_FULL or attempt == SEND_RETRIES:
                # An interface that is down is treated as full: the watchdogs at both ends detect the silence.
                self._counters.refuse(count, os.strerror(number))
                self.failure = self._counters.lasting_refusal
                self._note_failure(number)
                return
            attempt += 1
            self._counters.waited += attempt == 1
            time.sleep(SEND_RETRY_S)

    def _note_failure(self, number: int) -> None:
        if number in GONE:
            self.failure = f"its interface is gone ({os.strerror(number)})"

    def receive(self) -> list[Frame]:
        """The frames that have arrived, at most `MAX_BURST`."""
        frames: list[Frame] = []
        count = BATCH
        while count == BATCH and len(frames) < MAX_BURST:
            headers = self._incoming.headers
            count = self._receive_batch(self._descriptor, headers, BATCH, socket.MSG_DONTWAIT, None)
            if count < 0:
                if (number := ctypes.get_errno()) not in NOTHING_TO_RECEIVE:
                    raise OSError(number, os.strerror(number))
                self._note_failure(number)
                return frames
            frames += unpack(self._incoming.buffer[: count * FRAME_BYTES], self._counters, self._requests)
        return frames

    def receive_stamped(self, until_ns: int = NO_END_NS) -> list[tuple[int, Frame]]:
        """The frames that have arrived, with the kernel's wall clock in ns.

        One system call each: the recorder has time, and Python's own socket reads the stamps.
        """
        frames: list[tuple[int, Frame]] = []
        while self.newest_ns < until_ns:
            try:
                content, ((_, _, stamp),), _, _ = self._socket.recvmsg(
                    FRAME_BYTES, socket.CMSG_SPACE(STAMP.size), socket.MSG_DONTWAIT
                )
            except OSError as error:
                if error.errno not in NOTHING_TO_RECEIVE:
                    raise
                break
            seconds, nanoseconds = STAMP.unpack(stamp)
            self.newest_ns = seconds * NS_PER_S + nanoseconds
            frames += [(self.newest_ns, frame) for frame in unpack(content, self._counters)]
        return frames

    def _drops(self) -> int:
        """Number of frames that this socket has dropped so far, modulo 2³²."""
        numbers = self._socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size)
        return int(MEMINFO.unpack(numbers)[-1])

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._descriptor

    def close(self) -> None:
        """Leave the bus."""
        self._counters = self.counters
        self._socket.close()
