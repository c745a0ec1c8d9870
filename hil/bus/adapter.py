"""Any python-can interface as a bus, for real adapters; slower than the bench's own sockets."""

import queue
import threading
import time
from collections.abc import Iterable

import can

from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST, SEND_RETRIES, SEND_RETRY_S, BusCounters, BusError, Connection
from hil.bus.wire import REMOTE_FLAG

BITRATE = 1_000_000
"""Bit rate of the bench's bus; interfaces without a bit rate ignore it."""
LOOK_S = 0.05
"""Longest wait of the thread that reads the adapter, after which it looks whether the bus is closed."""


def open_adapter(interface: str, channel: str) -> can.BusABC:
    """Open `channel` of python-can's `interface`; `BusError` if it does not open."""
    try:
        return can.Bus(channel, interface, bitrate=BITRATE)
    except Exception as error:  # each interface raises what its driver's library raises
        known = ", ".join(sorted(can.VALID_INTERFACES))
        reason = str(error) or type(error).__name__
        raise BusError(
            f"bus {interface}:{channel} did not open: {reason}; wanted auto, vcan, local or one of "
            f"python-can's interfaces ({known}) with its channel, e.g. socketcan:can0"
        ) from error


class AdapterBus(Connection):
    """A node on `interface:channel` of python-can.

    A thread reads the adapter, because many interfaces have no descriptor to wait for, and a read without
    waiting takes a millisecond on some.
    """

    def __init__(self, interface: str, channel: str, accept: Iterable[int] | None) -> None:
        super().__init__()
        self.counters = BusCounters(lost=None)
        # Filtered here: the drivers' own filters differ in what they do with remote and error frames
        self._accept = None if accept is None else frozenset(accept)
        self._name = f"{interface}:{channel}"
        self._bus = open_adapter(interface, channel)
        self._arrived: queue.SimpleQueue[tuple[int, can.Message | can.CanError]] = queue.SimpleQueue()
        self._first: tuple[int, can.Message | can.CanError] | None = None
        """What has ended a wait; it precedes what the queue holds."""
        self._is_closed = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Queue each message with our wall clock in ns at its arrival, and the adapter's failure."""
        while not self._is_closed.is_set():
            try:
                message = self._bus.recv(LOOK_S)
            except can.CanError as error:
                self._arrived.put((time.time_ns(), error))
                return
            if message is not None:
                self._arrived.put((time.time_ns(), message))

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order."""
        for can_id, data in frames:
            self.counters.sent += 1
            message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False, check=False)
            try:
                self._bus.send(message, timeout=SEND_RETRIES * SEND_RETRY_S)
            except can.CanError:
                self.counters.unsent += 1

    def receive(self) -> list[Frame]:
        """All frames that have arrived."""
        return [frame for _, frame in self.receive_stamped()]

    def receive_stamped(self) -> list[tuple[int, Frame]]:
        """All frames that have arrived, with the wall clock in ns when the adapter handed each over."""
        frames: list[tuple[int, Frame]] = []
        for _ in range(MAX_BURST):
            if (arrival := self._next_arrival(0.0)) is None:
                break
            now_ns, message = arrival
            if isinstance(message, can.CanError):
                self._first = arrival  # for the next call, after the frames before it
                if frames:
                    break
                raise BusError(
                    f"bus {self._name} has failed: {message}; is the adapter still connected?"
                ) from message
            if self._is_for_us(message):
                frames.append((now_ns, Frame(message.arbitration_id, bytes(message.data))))
        return frames

    def _is_for_us(self, message: can.Message) -> bool:
        """Whether this node accepts the message; counts foreign ones."""
        if not message.is_rx:
            return False  # our own, which some interfaces return
        can_id = message.arbitration_id | (REMOTE_FLAG if message.is_remote_frame else 0)
        is_accepted = self._accept is None or can_id in self._accept
        is_asked = self._accept is not None and is_accepted
        is_foreign = message.is_extended_id or message.is_error_frame or message.is_fd
        if is_foreign or (message.is_remote_frame and not is_asked):
            self.counters.foreign += 1
            return False
        return is_accepted

    def _next_arrival(self, timeout_s: float) -> tuple[int, can.Message | can.CanError] | None:
        if self._first is not None:
            first, self._first = self._first, None
            return first
        try:
            return self._arrived.get(timeout=timeout_s) if timeout_s > 0.0 else self._arrived.get_nowait()
        except queue.Empty:
            return None

    def wait(self, timeout_s: float) -> None:
        """Return when frames have arrived or after `timeout_s`."""
        self._first = self._next_arrival(timeout_s)

    def fileno(self) -> int:
        """No descriptor: -1."""
        return -1

    def close(self) -> None:
        """Leave the bus."""
        self._is_closed.set()
        self._reader.join()
        self._bus.shutdown()
