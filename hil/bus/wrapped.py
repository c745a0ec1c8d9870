"""A bus in front of another one: passes every call on; a subclass changes what it is for."""

from collections.abc import Iterable

from firmware_py.interface.frame import Frame
from hil.bus.base import NO_END_NS, Bus, BusCounters, Connection


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
