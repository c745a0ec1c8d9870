"""Passes frames between the nodes of one process without delay."""

from collections.abc import Iterable

from firmware_py.interface.frame import Frame

Logged = tuple[int, list[Frame]]
"""Frames and their common time in ns."""


class InProcessBus:
    """A bus in memory: `receive` of each node returns the frames that the other nodes have sent."""

    def __init__(self) -> None:
        self._nodes: list[InProcessNode] = []

    def join(self) -> "InProcessNode":
        """Add a node and return its connection."""
        node = InProcessNode()
        for other in self._nodes:
            other.others.append(node)
            node.others.append(other)
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


class InProcessNode(Inbox):
    """One node's connection; no frame is lost or late."""

    def __init__(self) -> None:
        super().__init__()
        self.others: list[InProcessNode] = []

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Hand frames to all others."""
        for other in self.others:
            other.pending.extend(frames)


class IdealBus:
    """The bus of lockstep without a bus model: frames arrive without delay, and are logged."""

    breaks: tuple[type, ...] = ()
    """The kinds of faults that act in the bus itself, and not on a node's line to it."""
    bit_ns = 0
    """Frames take no time."""
    is_at_rest = True
    """No frame is under way, and no error is counted."""

    def __init__(self) -> None:
        self._bus = InProcessBus()
        self._log = self._bus.join()

    def join(self, name: str) -> InProcessNode:
        """The connection of one of the nodes."""
        return self._bus.join()

    def pass_time(self, from_ns: int, to_ns: int) -> list[Logged]:
        """Return the frames sent since the last call, logged at `from_ns`."""
        return [(from_ns, self._log.receive())]

    def rest_until(self, t_ns: int) -> None:
        """Do nothing: no frame is under way."""

    def close(self) -> None:
        """Do nothing: the ideal bus has no files."""
