"""python-can interfaces made for tests: each joins a hub, as its wire, and behaves like one kind of adapter.

The channel is the path of the hub's socket. `installed` makes them known to the programs that a test starts.
"""

import fcntl
import time
from collections import deque
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Any

import can

from hil.bus.local import LocalBus

WRAP_S = 2**32 * 1e-6
"""A device's counter of microseconds with 32 bits wraps round after 71 minutes."""


class WithoutDescriptor(LocalBus):
    """As gs_usb, pcan, kvaser, vector and virtual: nothing to hand to `select`."""

    def fileno(self) -> int:
        raise NotImplementedError("fileno is not implemented using current CAN bus")


class DeviceTime(WithoutDescriptor):
    """Stamps with the device's time since its start, 100 ppm fast; the counter wraps round soon after it."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._opened_s = time.time()
        super().__init__(*args, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, filtered = super()._recv_internal(timeout)
        if message is not None:
            device_s = WRAP_S - 1.0 + (message.timestamp - self._opened_s) * (1.0 + 1e-4)
            message.timestamp = device_s % WRAP_S
        return message, filtered


class OneProgram(WithoutDescriptor):
    """Can be opened by one program at a time, and never returns what that program sends."""

    def __init__(self, channel: str, *args: Any, receive_own_messages: bool = False, **kwargs: Any) -> None:
        if receive_own_messages:
            raise can.CanInitializationError("this adapter does not return own messages")
        self._claim = Path(f"{channel}.claim").open("w")  # noqa: SIM115  held until the shutdown
        try:
            fcntl.flock(self._claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._claim.close()
            raise can.CanInitializationError("the adapter is in use by another program") from error
        super().__init__(channel, *args, **kwargs)

    def shutdown(self) -> None:
        super().shutdown()
        self._claim.close()


class OwnMessages(WithoutDescriptor):
    """Returns its own messages, marked as sent."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._sent: deque[can.Message] = deque()
        super().__init__(*args, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        super().send(msg, timeout)
        own = copy(msg)
        own.is_rx = False
        self._sent.append(own)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._sent:
            return self._sent.popleft(), False
        return super()._recv_internal(timeout)


class Late(WithoutDescriptor):
    """Delivers what has arrived in bundles, one every 8 ms, as a USB adapter with a latency timer."""

    BUNDLE_S = 0.008

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._held: deque[can.Message] = deque()
        self._delivered: deque[can.Message] = deque()
        self._due_s = time.monotonic() + self.BUNDLE_S
        super().__init__(*args, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._delivered:
            rest_s = max(0.0, self._due_s - time.monotonic())
            time.sleep(rest_s if timeout is None else min(rest_s, timeout))
            while (message := super()._recv_internal(0)[0]) is not None:
                self._held.append(message)
            if time.monotonic() >= self._due_s:
                self._delivered, self._held = self._held, deque()
                self._due_s = time.monotonic() + self.BUNDLE_S
        return (self._delivered.popleft() if self._delivered else None), True


class ErrorFrames(WithoutDescriptor):
    """Reports an error frame before each tenth message."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._count = 0
        self._after: can.Message | None = None
        super().__init__(*args, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._after is not None:
            message, self._after = self._after, None
            return message, True
        message, filtered = super()._recv_internal(timeout)
        if message is not None:
            self._count += 1
            if self._count % 10 == 0:
                self._after = message
                return can.Message(timestamp=message.timestamp, is_error_frame=True, dlc=8), True
        return message, filtered


class Unplugged(WithoutDescriptor):
    """Fails at the tenth message."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._count = 0
        super().__init__(*args, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, filtered = super()._recv_internal(timeout)
        self._count += message is not None
        if self._count >= 10:
            raise can.CanOperationError("the device is gone")
        return message, filtered


class Cut(WithoutDescriptor):
    """Fails at each message that it is to send, with an error of its driver's library."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise OSError("the device does not answer")


class Glitch(WithoutDescriptor):
    """Raises one error between two messages, and goes on."""

    _has_raised = False

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, filtered = super()._recv_internal(timeout)
        if message is None and not self._has_raised:
            self._has_raised = True
            raise can.CanOperationError("receive overrun")
        return message, filtered


class Refusing(WithoutDescriptor):
    """Refuses some of the messages that it is to send, counted from the first, as if its queue were full."""

    refused: Sequence[int] = range(20, 320)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._number = -1
        super().__init__(*args, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._number += 1
        if self._number in self.refused:
            raise can.CanOperationError("the transmit buffer is full")
        super().send(msg, timeout)


class RefusingForEver(Refusing):
    refused = range(20, 10**9)


class RefusingAgain(Refusing):
    refused = (*range(20, 320), *range(400, 700))


class NotYet(Refusing):
    refused = range(1200)


REFUSING = {
    "made-refusing-for-300-ms": Refusing,
    "made-refusing-for-ever": RefusingForEver,
    "made-refusing-again": RefusingAgain,
}
"""By their names; a node sends one message each millisecond."""
INTERFACES = {
    "made-descriptor": LocalBus,
    "made-no-descriptor": WithoutDescriptor,
    "made-device-time": DeviceTime,
    "made-one-program": OneProgram,
    "made-own-messages": OwnMessages,
    "made-late": Late,
    "made-error-frames": ErrorFrames,
    "made-unplugged": Unplugged,
    "made-cut": Cut,
    "made-glitch": Glitch,
    "made-not-yet": NotYet,
    **REFUSING,
}


def installed(folder: Path, monkeypatch: Any) -> None:
    """Make the interfaces known to this process and, by an entry point on PYTHONPATH, to its children."""
    package = folder / "made_adapters-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: made-adapters\nVersion: 1\n")
    lines = [f"{name} = made_adapters:{kind.__name__}" for name, kind in INTERFACES.items()]
    lines[0] = "made-descriptor = hil.bus.local:LocalBus"
    (package / "entry_points.txt").write_text("\n".join(["[can.interface]", *lines, ""]))
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{Path(__file__).parent}")
    for name, kind in INTERFACES.items():
        monkeypatch.setitem(can.interfaces.BACKENDS, name, (kind.__module__, kind.__name__))
    for module in (can, can.interfaces, can.util):
        monkeypatch.setattr(module, "VALID_INTERFACES", can.VALID_INTERFACES | set(INTERFACES))
