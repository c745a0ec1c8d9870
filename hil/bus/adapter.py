"""Any python-can interface as a bus, for real adapters; slower than the bench's own sockets."""

from collections.abc import Iterable

import can

from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST, SEND_RETRIES, SEND_RETRY_S, BusCounters, BusError, Connection
from hil.bus.wire import REMOTE_FLAG

BITRATE = 1_000_000
"""Bit rate of the bench's bus; interfaces without a bit rate ignore it."""


class AdapterBus(Connection):
    """A node on `interface:channel` of python-can."""

    def __init__(self, interface: str, channel: str, accept: Iterable[int] | None) -> None:
        super().__init__()
        self.counters = BusCounters(lost=None)
        # Filtered here: with python-can's own filter a read without waiting ends at the first rejected frame
        self._accept = None if accept is None else frozenset(accept)
        try:
            self._bus = can.Bus(channel, interface, bitrate=BITRATE)
        except (can.CanError, OSError, ValueError) as error:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise BusError(
                f"bus {interface}:{channel} did not open: {error}; wanted auto, vcan, local or one of "
                f"python-can's interfaces ({known}) with its channel, e.g. socketcan:can0"
            ) from error

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order."""
        for can_id, data in frames:
            message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False, check=False)
            try:
                self._bus.send(message, timeout=SEND_RETRIES * SEND_RETRY_S)
            except can.CanError:
                self.counters.unsent += 1

    def receive(self) -> list[Frame]:
        """All frames that have arrived."""
        return [frame for _, frame in self.receive_stamped()]

    def receive_stamped(self) -> list[tuple[int, Frame]]:
        """All frames that have arrived, with the interface's time stamps in ns."""
        frames = []
        for _ in range(MAX_BURST):
            message = self._bus.recv(timeout=0)
            if message is None:
                break
            can_id = message.arbitration_id | (REMOTE_FLAG if message.is_remote_frame else 0)
            is_accepted = self._accept is None or can_id in self._accept
            is_asked = self._accept is not None and is_accepted
            is_foreign = message.is_extended_id or message.is_error_frame or message.is_fd
            if is_foreign or (message.is_remote_frame and not is_asked):
                self.counters.foreign += 1
                continue
            if not is_accepted:
                continue
            stamp_ns = int(message.timestamp * 1e9)
            frames.append((stamp_ns, Frame(message.arbitration_id, bytes(message.data))))
        return frames

    def fileno(self) -> int:
        """The interface's descriptor; -1 where it has none."""
        return self._bus.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
