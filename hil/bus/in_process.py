"""The bus of lockstep: passes frames between the nodes of one process without delay."""

from collections.abc import Iterable

from firmware_py.interface.frame import Frame


class InProcessBus:
    """A bus in memory: `receive` of each node returns the frames that the other nodes have sent."""

    def __init__(self) -> None:
        self._nodes: list[InProcessNode] = []

    def join(self, listening: bool = True) -> "InProcessNode":
        """Add a node and return its connection; a node that only sends joins with `listening` False."""
        node = InProcessNode()
        for other in self._nodes:
            if listening:
                other.others.append(node)
            if other.listening:
                node.others.append(other)
        node.listening = listening
        self._nodes.append(node)
        return node


class Inbox:
    """The receiving side of a connection in one process: frames stay queued until the node reads them."""

    def __init__(self) -> None:
        self.pending: list[Frame] = []

    def receive(self) -> list[Frame]:
        """The frames received since the last call."""
        received, self.pending = self.pending, []
        return received

    def wait(self, _: float) -> None:
        """Return at once: no frame can arrive while a node of the same process waits."""


class InProcessNode(Inbox):
    """One node's connection; no frame is lost or late."""

    def __init__(self) -> None:
        super().__init__()
        self.listening = True
        self.others: list[InProcessNode] = []

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Hand frames to all others."""
        for other in self.others:
            other.pending.extend(frames)
