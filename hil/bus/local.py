"""The bus `local` as a python-can interface: `candump`-like tools join a run without kernel CAN.

`python -m can.logger -i vibrohil -c PATH`, with the path that the run prints after `local:`.
"""

import select
from collections import deque
from pathlib import Path
from typing import Any

import can

from firmware_py.interface.frame import Frame
from hil.bus.base import BusError
from hil.bus.hub_socket import HELLO_STAMPED, HubSocket


class LocalBus(can.BusABC):
    """python-can's view of the hub at `channel`, the path of its socket."""

    def __init__(self, channel: str, can_filters: Any = None, **kwargs: Any) -> None:
        try:
            self._hub = HubSocket(Path(channel), HELLO_STAMPED)
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self._pending: deque[tuple[int, Frame]] = deque()
        self._can_protocol = can.CanProtocol.CAN_20
        self.channel_info = f"local:{channel}"
        super().__init__(channel, can_filters=can_filters, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if (message := self._next_message()) is None and timeout != 0:
            select.select([self._hub], [], [], timeout)
            message = self._next_message()
        return message, True

    def _next_message(self) -> can.Message | None:
        """The next frame that the filters let through, of those that have arrived."""
        self._pending.extend(self._hub.receive_stamped())
        while self._pending:
            stamp_ns, frame = self._pending.popleft()
            message = can.Message(
                timestamp=stamp_ns * 1e-9, arbitration_id=frame.can_id, data=frame.data, is_extended_id=False
            )
            if self._matches_filters(message):
                return message
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue one classic data frame with an 11-bit identifier; a queue that stays full raises."""
        if msg.is_extended_id or msg.is_remote_frame or msg.is_error_frame or msg.is_fd:
            raise can.CanOperationError("the bus carries classic data frames with 11-bit identifiers only")
        unsent = self._hub.counters.unsent
        self._hub.send(Frame(msg.arbitration_id, bytes(msg.data)))
        if self._hub.counters.unsent > unsent:
            raise can.CanOperationError("the transmit queue is full")

    def fileno(self) -> int:
        """The descriptor that becomes readable when frames arrive."""
        return self._hub.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._hub.close()
