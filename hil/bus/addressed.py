"""A node's bus for a module with other node numbers than the default: translates the identifiers.

A frame without a sender among the module's nodes is not delivered.
"""

from collections.abc import Iterable

from firmware_py.interface.addresses import DEFAULT, NOT_OURS, Addresses, bus_id, module_id
from firmware_py.interface.frame import Frame
from hil.bus.base import NO_END_NS, Bus, WrappedBus


def addressed(bus: Bus, places: Addresses) -> Bus:
    """The bus with the identifiers of the module at `places` translated to those of `vibro.dbc`."""
    return bus if places == DEFAULT else AddressedBus(bus, places)


class AddressedBus(WrappedBus):
    """A bus that carries the module's identifiers; its node sends and receives those of `vibro.dbc`."""

    def __init__(self, bus: Bus, places: Addresses) -> None:
        super().__init__(bus)
        self._places = places

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames in order."""
        self.inner.send_all([Frame(bus_id(self._places, can_id), data) for can_id, data in frames])

    def receive(self) -> list[Frame]:
        """The module's frames that have arrived."""
        return [
            Frame(can_id, frame.data)
            for frame in self.inner.receive()
            if (can_id := module_id(self._places, frame.can_id)) != NOT_OURS
        ]

    def receive_stamped(self, until_ns: int = NO_END_NS) -> list[tuple[int, Frame]]:
        """Like `receive`, with each frame's arrival on the wall clock in ns, up to `until_ns`."""
        return [
            (stamp_ns, Frame(can_id, frame.data))
            for stamp_ns, frame in self.inner.receive_stamped(until_ns)
            if (can_id := module_id(self._places, frame.can_id)) != NOT_OURS
        ]
