"""The modelled bus for nodes that run in one process: each sends and receives as on any other bus.

Time is handed in: `move_to` before the nodes' turn, then what they send is queued at that time, and what they
receive has arrived by then.
"""

from collections.abc import Iterable, Sequence

from firmware_py.interface.frame import Frame
from hil.bus.base import BusCounters
from hil.can_model.modelled_bus import Delivery, ModelledBus


class ModelledInProcessBus:
    """A bus of named nodes; `model` takes the faults."""

    def __init__(self, names: Sequence[str], bitrate: int = 1_000_000) -> None:
        self.model = ModelledBus(names, bitrate)
        self.t_ns = 0
        self._nodes = {name: ModelledNode(self, name) for name in names}

    def join(self, name: str) -> "ModelledNode":
        """The connection of one of the nodes."""
        return self._nodes[name]

    def move_to(self, t_ns: int) -> list[Delivery]:
        """Let time pass until `t_ns`; hand out what has arrived, and return it with its times."""
        self.t_ns = t_ns
        deliveries = self.model.deliver(t_ns)
        for delivery in deliveries:
            for name in delivery.receivers:
                self._nodes[name].pending.append(delivery.frame)
        return deliveries


class ModelledNode:
    """One node's side. A node that never reads keeps what it has received."""

    def __init__(self, bus: ModelledInProcessBus, name: str) -> None:
        self._bus = bus
        self._name = name
        self.pending: list[Frame] = []

    @property
    def counters(self) -> BusCounters:
        """Frames that the node could not queue, or that it threw away when it went off."""
        return BusCounters(unsent=self._bus.model.lost(self._name))

    def send(self, frame: Frame) -> None:
        """Queue one frame now."""
        self._bus.model.submit(self._name, frame, self._bus.t_ns)

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames now; the lowest identifier leaves first, whatever their order."""
        for frame in frames:
            self._bus.model.submit(self._name, frame, self._bus.t_ns)

    def receive(self) -> list[Frame]:
        """The frames received since the last call."""
        received, self.pending = self.pending, []
        return received

    def wait(self, _: float) -> None:
        """Nothing arrives while a node of the same process waits."""
