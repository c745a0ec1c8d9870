"""A node on the bus `local`: a stream to and from the hub; one system call moves all frames of a tick.

A node that takes turns (`hil.timing.pacemaker`) receives the frames of a turn with the mark of its beginning
behind them, and sends its own frames with the mark of its end behind them: one system call for each.
"""

import socket
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from firmware_py.interface.frame import Frame
from hil.bus import wire
from hil.bus.base import MAX_BURST, NO_END_NS, SEND_RETRIES, SEND_RETRY_S, BusCounters, BusError, Connection
from hil.roster import members
from hil.timing.pacemaker import Turn

HELLO = wire.CAN_FRAME.pack(wire.CONTROL_ID, 0, b"vibro-1\0")
HELLO_STAMPED = wire.CAN_FRAME.pack(wire.CONTROL_ID, 1, b"vibro-1\0")
"""The greeting of a node that requests the time at which each frame passed the hub."""
HELLO_SEND_ONLY = wire.CAN_FRAME.pack(wire.CONTROL_ID, 2, b"vibro-1\0")
"""The greeting of a node that only sends."""

FIRST_MEMBER = 16
"""The greeting of a node that takes turns: its number among `hil.roster.members`, plus this."""

TURN_MARK = wire.CONTROL_MARK + bytes((wire.TURN_KIND,))
MARKS_BYTES = 2 * wire.FRAME_BYTES
"""The mark of a turn's beginning: when it was due, and its tick."""

LARGEST_WORD = (1 << 32) - 1
JOIN_TIMEOUT_S = 5.0


def member_greeting(member: str) -> bytes:
    """The greeting of a node that takes turns."""
    number = FIRST_MEMBER + members().index(member)
    return wire.CAN_FRAME.pack(wire.CONTROL_ID, number, b"vibro-1\0")


class HubSocket(Connection):
    """A node on the bus `local`: a stream socket to the hub."""

    def __init__(self, path: Path, greeting: bytes = HELLO, requests: frozenset[int] = frozenset()) -> None:
        self.counters = BusCounters()
        self._requests = requests
        self._received = b""
        self._unfinished = b""
        self.newest_ns = 0
        self.ended = False
        """Whether the hub has ended; noticed at the next send or receive."""
        self._address = f"local:{path}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(JOIN_TIMEOUT_S)
        try:
            self._socket.connect(str(path))
            self._socket.sendall(greeting)
            answer = self._socket.recv(wire.FRAME_BYTES, socket.MSG_WAITALL)
        except OSError as error:
            self._socket.close()
            raise BusError(
                f"no hub answers at local:{path} ({error}); wanted the address that a running "
                "`vibrohil run` or `vibrohil plant --bus local` prints"
            ) from error
        if answer != HELLO:
            self._socket.close()
            raise BusError(
                f"what listens at local:{path} is no hub of this version: it sent {answer!r}; start "
                "both sides with one version of vibrohil"
            )
        self._socket.setblocking(False)

    @property
    def failure(self) -> str:
        """Why the bus carries no more frames; empty while it works."""
        return "its hub has ended" if self.ended else self.counters.lasting_refusal

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in one system call."""
        if packed := wire.pack(frames):
            self.counters.sent += len(packed) // wire.FRAME_BYTES
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
                self.ended = True
                break
            if sent == len(packed):
                self._unfinished = b""
                return
            packed = packed[sent:]
        # The rest of a partly sent frame is sent first next time, which keeps the stream aligned to frames.
        self._unfinished = packed[: len(packed) % wire.FRAME_BYTES]
        reason = "its hub has ended" if self.ended else "the transmit queue is full"
        self.counters.refuse(len(packed) // wire.FRAME_BYTES, f"{self._address}: {reason}")

    def _read(self, most: int = MAX_BURST) -> bytes:
        """The whole frames that have arrived, at most `most`."""
        try:
            chunk = self._socket.recv(most * wire.FRAME_BYTES - len(self._received))
        except BlockingIOError:
            return b""
        except ConnectionError:
            chunk = b""
        self.ended = self.ended or not chunk
        chunk, self._received = wire.whole_frames(self._received + chunk)
        return chunk

    def receive(self) -> list[Frame]:
        """All frames that have arrived."""
        return self._unpack(self._read())

    def _unpack(self, chunk: bytes) -> list[Frame]:
        if wire.CONTROL_MARK in chunk:
            messages = (
                wire.CAN_FRAME.pack(can_id, len(data), data) for _, can_id, data in self._messages_in(chunk)
            )
            chunk = b"".join(messages)
        return wire.unpack(chunk, self.counters, self._requests)

    def receive_stamped(self, until_ns: int = NO_END_NS) -> list[tuple[int, Frame]]:
        """The frames that have arrived, with the hub's wall clock in ns when it forwarded each."""
        frames = []
        while self.newest_ns < until_ns and (chunk := self._read()):
            for stamp_ns, can_id, data in self._messages_in(chunk):
                if can_id <= wire.MAX_STANDARD_ID:
                    frames.append((stamp_ns, Frame(can_id, data)))
                else:
                    self.counters.foreign += 1
        return frames

    def receive_any(self) -> tuple[int, int, bytes] | None:
        """The next message of any kind: time in ns, identifier with SocketCAN's flags, data.

        Only this message is taken from the socket, so its descriptor stays readable while others wait.
        """
        while chunk := self._read(most=1):
            for message in self._messages_in(chunk):
                return message
        return None

    def _messages_in(self, chunk: bytes) -> Iterator[tuple[int, int, bytes]]:
        """Yield time, identifier with flags, and data of `chunk`'s messages; evaluate its control records."""
        for can_id, length, data in wire.CAN_FRAME.iter_unpack(chunk):
            if can_id == wire.CONTROL_ID and length == wire.LOSS_KIND:
                self.counters.lost += int.from_bytes(data, "little")
            elif can_id == wire.CONTROL_ID:
                self.newest_ns = int.from_bytes(data, "little")
            else:
                yield self.newest_ns, can_id, data[:length]

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._socket.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()


class TurnSocket(HubSocket):
    """A node that takes turns: its connection to the pacemaker, and on `local` also its bus.

    It may wait without limit for its turn. A turn's frames are sent at its end.
    """

    def __init__(self, path: Path, member: str, requests: frozenset[int] = frozenset()) -> None:
        super().__init__(path, member_greeting(member), requests)
        self._socket.settimeout(None)
        self._arrived = b""
        self.patience_s: float | None = None
        """Longest time to wait for a turn; after it there are no more turns."""
        self._outgoing = b""

    def await_turn(self) -> Turn | None:
        """Wait for the node's turn; None if there is none any more."""
        if self.patience_s != self._socket.gettimeout():
            self._socket.settimeout(self.patience_s)
        chunk = b""
        while chunk[-wire.FRAME_BYTES :][:5] != TURN_MARK:
            try:
                more = self._read()
            except TimeoutError:
                return None
            if not more and self.ended:
                return None
            chunk += more
        marks = [
            int.from_bytes(data, "little") for _, _, data in wire.CAN_FRAME.iter_unpack(chunk[-MARKS_BYTES:])
        ]
        self._arrived += chunk[:-MARKS_BYTES]  # a step that is late leaves the frames of its turn
        return Turn(tick=marks[1], due_ns=marks[0])

    def end_turn(self, cpu_ns: int, next_tick: int) -> None:
        """Send the turn's frames, and that it has ended: its CPU time, and the tick of the next turn."""
        end = wire.TURN_END.pack(min(cpu_ns // 1000, LARGEST_WORD), next_tick)
        packed, self._outgoing = self._outgoing, b""
        try:
            self._socket.sendall(packed + wire.control(wire.END_KIND, end))
        except ConnectionError:
            self.ended = True
            self.counters.refuse(len(packed) // wire.FRAME_BYTES, self.failure)

    def _write(self, packed: bytes) -> None:
        self._outgoing += packed

    def receive(self) -> list[Frame]:
        """The frames that had arrived when the turn began, since the last call."""
        chunk, self._arrived = self._arrived, b""
        return self._unpack(chunk)

    def leave(self) -> None:
        """Take no more turns; safe in a signal handler."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
