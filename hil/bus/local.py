"""The bus `local` as a python-can interface: `candump`-like tools join a run without kernel CAN.

`python -m can.logger -i vibrohil -c PATH`, with the path that the run prints after `local:`. Every
message of classic CAN passes: 11-bit and 29-bit identifiers, data and remote frames.
"""

import select
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import can

from firmware_py.interface.frame import Frame
from hil.bus.base import BusError
from hil.bus.hub_socket import HELLO_STAMPED, HubSocket
from hil.bus.wire import REMOTE_FLAG

EXTENDED_FLAG = 0x80000000
"""SocketCAN's flag in the identifier of an extended frame."""
IDENTIFIER_MASK = 0x1FFFFFFF


class LocalBus(can.BusABC):
    """python-can's interface to the hub at `channel`, the path of its socket.

    A bit rate is accepted and ignored: the hub has none.
    """

    def __init__(
        self,
        channel: str | PathLike[str] | None = None,
        can_filters: Any = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        **kwargs: Any,
    ) -> None:
        if fd or receive_own_messages:
            raise can.CanInitializationError(
                "the bus is classic CAN and returns no frame to its sender; leave `fd` and "
                "`receive_own_messages` out"
            )
        if not isinstance(channel, str | PathLike):
            raise can.CanInitializationError(
                f"channel {channel!r} is no path; wanted the path that a running `vibrohil run` prints after "
                "`local:`"
            )
        path = fspath(channel).removeprefix("local:")
        try:
            self._hub = HubSocket(Path(path), HELLO_STAMPED)
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self._is_closed = False
        self._can_protocol = can.CanProtocol.CAN_20
        self.channel_info = f"local:{path}"
        super().__init__(path, can_filters=can_filters, **kwargs)

    @property
    def lost(self) -> int:
        """Messages lost because this program did not receive them in time."""
        return self._hub.counters.lost

    def _refuse_closed(self) -> None:
        if self._is_closed:
            raise can.CanOperationError(f"{self.channel_info}: this bus is shut down; open a new one")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._refuse_closed()
        if (message := self._next_message()) is None and timeout != 0 and not self._hub.ended:
            select.select([self._hub], [], [], timeout)
            message = self._next_message()
        if message is None and self._hub.ended:
            raise can.CanOperationError(f"{self.channel_info}: the hub has ended")
        return message, True

    def _next_message(self) -> can.Message | None:
        """The next message among those that have arrived that passes the filters; None if there is none."""
        while received := self._hub.receive_any():
            stamp_ns, can_id, data = received
            is_remote = bool(can_id & REMOTE_FLAG)
            message = can.Message(
                timestamp=stamp_ns * 1e-9,
                arbitration_id=can_id & IDENTIFIER_MASK,
                is_extended_id=bool(can_id & EXTENDED_FLAG),
                is_remote_frame=is_remote,
                dlc=len(data),
                data=None if is_remote else data,
                channel=self.channel_info,
            )
            if self._matches_filters(message):
                return message
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue one message of classic CAN; raises `CanOperationError` if the queue stays full."""
        self._refuse_closed()
        if msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError(
                "the bus carries classic data and remote frames: no CAN FD, no errors"
            )
        flags = (EXTENDED_FLAG if msg.is_extended_id else 0) | (REMOTE_FLAG if msg.is_remote_frame else 0)
        data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
        frame = Frame(msg.arbitration_id | flags, data)
        unsent = self._hub.counters.unsent
        self._hub.send(frame)
        if self._hub.counters.unsent > unsent or self._hub.ended:
            ended = "the hub has ended" if self._hub.ended else "the transmit queue is full"
            raise can.CanOperationError(f"{self.channel_info}: {ended}")

    def fileno(self) -> int:
        """A descriptor that is readable while messages wait."""
        self._refuse_closed()
        return self._hub.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._is_closed = True
        self._hub.close()
