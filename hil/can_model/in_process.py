"""The modelled bus for nodes in one process, with the same interface to a node as any other bus.

The caller sets the time by `move_to` before the nodes' steps: frames that they send are queued at that time,
and frames that they receive have arrived by then.
"""

from collections.abc import Iterable, Sequence

from firmware_py.interface.frame import Frame
from hil.bus.in_process import Inbox
from hil.can_model.modelled_bus import Delivery, ModelledBus


class ModelledInProcessBus:
    """A modelled bus of named nodes; faults are set on `model`."""

    def __init__(self, names: Sequence[str], bitrate: int = 1_000_000) -> None:
        self.model = ModelledBus(names, bitrate)
        self.t_ns = 0
        self._nodes = {name: ModelledNode(self, name) for name in names}

    def join(self, name: str) -> "ModelledNode":
        """The connection of one of the nodes."""
        return self._nodes[name]

    def move_to(self, t_ns: int) -> list[Delivery]:
        """Advance to `t_ns`; deliver the frames that have arrived, and return them with their times."""
        self.t_ns = t_ns
        deliveries = self.model.deliver(t_ns)
        for delivery in deliveries:
            for name in delivery.receivers:
                self._nodes[name].pending.append(delivery.frame)
        return deliveries


class ModelledNode(Inbox):
    """One node's connection."""

    def __init__(self, bus: ModelledInProcessBus, name: str) -> None:
        super().__init__()
        self._bus = bus
        self._name = name

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames now; they leave in the order of their identifiers, the lowest first."""
        for frame in frames:
            self._bus.model.submit(self._name, frame, self._bus.t_ns)
