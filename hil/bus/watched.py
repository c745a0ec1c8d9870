"""The bus of a node that is started singly: no supervisor watches its bus, so the node itself must notice."""

import select

from firmware_py.interface.frame import Frame
from hil.bus.base import Bus, BusCounters, BusFailedError, WrappedBus
from hil.bus.bridge_process import BridgeProcess


class WatchedBus(WrappedBus):
    """A bus whose `receive` raises BusFailedError when it carries no more frames.

    Its counters include those of the adapter's bridge.
    """

    def __init__(self, inner: Bus, name: str, bridge: BridgeProcess | None) -> None:
        super().__init__(inner)
        self._name = name
        self._bridge = bridge

    @property
    def counters(self) -> BusCounters:
        """The errors counted so far."""
        own = self.inner.counters
        return own if self._bridge is None else self._bridge.counted_for(own)

    @property
    def failure(self) -> str:
        """Why the bus carries no more frames; empty while it works."""
        if self._bridge is not None and (failure := self._bridge.failure):
            return failure
        return f"{self._name}: {self.inner.failure}" if self.inner.failure else ""

    def wait(self, timeout_s: float) -> None:
        """Return when frames or a report of the bridge have arrived, or after `timeout_s`."""
        sources: list[Bus | BridgeProcess] = (
            [self.inner] if self._bridge is None else [self.inner, self._bridge]
        )
        select.select(sources, [], [], timeout_s)

    def receive(self) -> list[Frame]:
        """The frames that have arrived; raises BusFailedError."""
        frames = self.inner.receive()
        if failure := self.failure:
            raise BusFailedError(
                f"the adapter has failed: {failure}; check its plug, supply and driver, and start this "
                "command again"
            )
        return frames
