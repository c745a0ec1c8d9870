"""The interface of every bus to a node, and the bus's counters."""

import logging
import select
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from firmware_py.interface.frame import Frame
from text_input import RefusalError

MAX_BURST = 4096
"""Largest number of frames that one `receive` returns, so that a flood of frames cannot block a node."""

NO_END_NS = sys.maxsize
"""A time on the wall clock after all others."""

OWN_BUSES = ("local", "vcan")
"""Names of the buses that are made for a run alone."""
SEND_RETRIES = 4
SEND_RETRY_S = 100e-6
"""A node retries a full transmit queue for 4 × 0.1 ms, less than half a tick; then it drops frames."""


LONGEST_REFUSAL_NS = 1_000_000_000
"""A bus that has carried frames and then refuses every one for this long has failed.

Before its first frame it may refuse for longer: a real bus carries none while no other node acknowledges.
"""

LOGGER = logging.getLogger(__name__)


class BusError(RefusalError, ValueError):
    """A bus cannot be opened as requested; the message states what was expected and the remedy."""


class BusFailedError(RefusalError, ConnectionError):
    """An open bus carries no more frames: its adapter has failed, its interface is gone, or its hub ended."""


@dataclass
class BusCounters:
    """Counts of a node's errors on the bus, in frames."""

    sent: int = 0
    """Frames that the node has handed over, `unsent` included."""
    waited: int = 0
    """Sends that met a full transmit queue and had to wait."""
    unsent: int = 0
    """Frames that the bus refused: its queue stayed full, its adapter took none, or it was gone."""
    first_unsent_ns: int | None = None
    """Time of the first of them on the monotonic clock."""
    refusal: str = ""
    """The reason for the first of them."""
    foreign: int = 0
    """Received frames other than classic data frames with an 11-bit identifier."""
    lost: int = 0
    """Frames that arrived while the receive queue was full."""
    receive_errors: int = 0
    """Errors of an adapter's receiving side, after which it went on."""
    refused_from_ns: int | None = None
    """Time of the first of the refusals that no carried frame has followed; None before any was carried."""
    carried: int = 0
    """Frames that the bus had carried at the last refusal."""
    lasting_refusal: str = ""
    """Why and for how long a bus that has carried frames now refuses every one; empty while it does not."""

    def refuse(self, frames: int, reason: str) -> None:
        """Count frames that were not sent, and report the first of them."""
        if frames == 0:
            return
        now_ns = time.monotonic_ns()
        if self.unsent == 0:
            self.first_unsent_ns, self.refusal = now_ns, reason
            LOGGER.warning("frames are refused and not sent: %s", reason)
        self.unsent += frames
        if (carried := self.sent - self.unsent) != self.carried:
            self.carried, self.refused_from_ns, self.lasting_refusal = carried, now_ns, ""
        elif self.refused_from_ns is not None and now_ns - self.refused_from_ns >= LONGEST_REFUSAL_NS:
            seconds = (now_ns - self.refused_from_ns) * 1e-9
            self.lasting_refusal = f"it has refused every frame for {seconds:.1f} s ({reason})"


class NodeBus(Protocol):
    """The interface of a bus to a node."""

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order, in as few system calls as the bus allows.

        Frames for which the queue stays full during the retries are dropped and counted.
        """

    def receive(self) -> list[Frame]:
        """All frames that have arrived, oldest first, without waiting."""


MOST_READS = 100
"""Most reads of a bus that empty it before a node begins; on a busy bus new frames arrive meanwhile."""


def discard_waiting(bus: NodeBus) -> None:
    """Receive and drop what was sent before a node begins; one `receive` may not take all of it."""
    for _ in range(MOST_READS):
        if not bus.receive():
            break


class Bus(NodeBus, Protocol):
    """One node's connection. It never receives its own frames; only `wait` may block longer than a send."""

    def wait(self, timeout_s: float) -> None:
        """Return when frames have arrived, or after `timeout_s`."""

    @property
    def counters(self) -> BusCounters:
        """The errors counted so far."""

    @property
    def failure(self) -> str:
        """Why the bus carries no more frames; empty while it works."""

    def receive_stamped(self, until_ns: int = NO_END_NS) -> list[tuple[int, Frame]]:
        """All frames that have arrived up to `until_ns`, and some that have arrived since.

        Each has its arrival on the wall clock in ns. For a bus opened with `stamped`.
        """

    @property
    def newest_ns(self) -> int:
        """The newest arrival that `receive_stamped` has read, of any frame: also of those it left out."""

    def fileno(self) -> int:
        """A descriptor that becomes readable when frames arrive."""

    def close(self) -> None:
        """Leave the bus."""


class Connection:
    """What every node's connection through a descriptor has in common."""

    def send(self: NodeBus, frame: Frame) -> None:
        """Queue one frame."""
        self.send_all((frame,))

    def wait(self: Bus, timeout_s: float) -> None:
        """Return when frames have arrived or after `timeout_s`."""
        select.select([self], [], [], timeout_s)


class WrappedBus(Connection):
    """A node's connection through the bus `inner`."""

    def __init__(self, inner: Bus) -> None:
        self.inner = inner

    @property
    def counters(self) -> BusCounters:
        """The errors counted so far."""
        return self.inner.counters

    @property
    def failure(self) -> str:
        """Why the bus carries no more frames; empty while it works."""
        return self.inner.failure

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order."""
        self.inner.send_all(frames)

    def receive(self) -> list[Frame]:
        """The frames that have arrived."""
        return self.inner.receive()

    def receive_stamped(self, until_ns: int = NO_END_NS) -> list[tuple[int, Frame]]:
        """Like `receive`, with each frame's arrival on the wall clock in ns, up to `until_ns`."""
        return self.inner.receive_stamped(until_ns)

    @property
    def newest_ns(self) -> int:
        """The newest arrival on the bus."""
        return self.inner.newest_ns

    def fileno(self) -> int:
        """The bus's descriptor."""
        return self.inner.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self.inner.close()
