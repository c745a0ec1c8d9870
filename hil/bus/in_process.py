"""The bus of lockstep: passes frames between the nodes of one process without delay."""

from collections.abc import Iterable

from firmware_py.interface.frame import Frame
from hil.bus.base import BusCounters


class InProcessBus:
    """Nodes join it and find in `receive` what the others have sent since."""

    def __init__(self) -> None:
        self._nodes: list[InProcessNode] = []

    def join(self, listening: bool = True) -> "InProcessNode":
        """A new node's connection; one that only sends need not read."""
        node = InProcessNode()
        for other in self._nodes:
            if listening:
                other.others.append(node)
            if other.listening:
                node.others.append(other)
        node.listening = listening
        self._nodes.append(node)
        return node


class InProcessNode:
    """One node's side; nothing is ever lost or late."""

    def __init__(self) -> None:
        self.counters = BusCounters()
        self.listening = True
        self.others: list[InProcessNode] = []
        self.pending: list[Frame] = []

    def send(self, frame: Frame) -> None:
        """Hand one frame to all others."""
        for other in self.others:
            other.pending.append(frame)

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Hand frames to all others."""
        for other in self.others:
            other.pending.extend(frames)

    def receive(self) -> list[Frame]:
        """The frames of the other nodes since the last call."""
        received, self.pending = self.pending, []
        return received

    def wait(self, _: float) -> None:
        """Nothing arrives while a node of the same process waits."""
