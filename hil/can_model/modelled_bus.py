"""The bus model for named nodes and times in nanoseconds: submit frames, collect delivered frames.

Nodes of one process join it as any other bus.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from firmware_py.interface.frame import Frame
from hil.bus.in_process import Inbox
from hil.can_model import core
from hil.can_model.bits import bit_ns_of
from hil.can_model.fault_confinement import ErrorCounters
from hil.can_model.state import Arrival, BusState, Corruption, NodeState

QUEUE_FRAMES = 64
"""Largest number of frames queued in a node's driver and controller; a further frame is lost."""


class Delivery(NamedTuple):
    """A frame that has ended; a second node that sent the same bits at once is not among the receivers."""

    t_ns: int
    sender: str
    frame: Frame
    receivers: tuple[str, ...]


class BusFigures(NamedTuple):
    """Counts since the start."""

    frames: int
    """Transmissions without error."""
    errors: int
    """Transmissions that failed."""
    busy_ns: int
    """Bus time of all transmissions, including intermissions."""
    lost: int
    """Frames that their node refused or discarded."""


class ModelledBus:
    """A deterministic CAN bus of named nodes.

    Time only moves forward: a frame takes part in every arbitration from its submission on.
    """

    def __init__(self, nodes: Sequence[str], bitrate: int = 1_000_000) -> None:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node names {list(nodes)}; wanted each once")
        self._names = tuple(nodes)
        self._numbers = {name: number for number, name in enumerate(nodes)}
        self._bit_ns = bit_ns_of(bitrate)
        self._state = BusState(nodes=tuple(NodeState() for _ in nodes))
        self._under_way: list[Delivery] = []
        self._receivers: dict[tuple[int, ...], tuple[str, ...]] = {}
        self._joined = {name: ModelledNode(self, name) for name in nodes}
        self.t_ns = 0
        """The time at which frames of joined nodes are queued, set by `move_to`."""

    def submit(self, node: str, frame: Frame, t_ns: int) -> None:
        """Queue `frame` at `node`; it is lost if the node is bus-off or its queue full."""
        number = self._number(node)
        self._advance(t_ns)
        self._state = core.queue(self._state, number, frame, QUEUE_FRAMES)

    def deliver(self, until_ns: int) -> list[Delivery]:
        """Return the frames that have arrived since the last call and not after `until_ns`, in order."""
        self._advance(until_ns)
        arrived = self._under_way
        self._under_way = []
        while arrived and arrived[-1].t_ns > until_ns:
            self._under_way.insert(0, arrived.pop())
        return arrived

    def join(self, node: str) -> "ModelledNode":
        """The connection of one of the nodes."""
        return self._joined[node]

    def move_to(self, t_ns: int) -> list[Delivery]:
        """Advance to `t_ns`; the nodes receive the frames that have arrived, which are returned."""
        self.t_ns = t_ns
        deliveries = self.deliver(t_ns)
        for delivery in deliveries:
            for name in delivery.receivers:
                self._joined[name].pending.append(delivery.frame)
        return deliveries

    # --- faults: each acts from the time of the last call on -----------------------------------------

    def corrupt(self, can_id: int | None = None, hits: int = 1) -> None:
        """Destroy the next `hits` transmissions with this identifier (None: of all frames)."""
        if hits < 1:
            raise ValueError(f"hits = {hits}; wanted 1 or more")
        corruption = Corruption(can_id, hits)
        self._state = self._state._replace(corruptions=(*self._state.corruptions, corruption))

    def end_corruption(self) -> None:
        """End all disturbances."""
        self._state = self._state._replace(corruptions=())

    def switch_off(self, node: str) -> None:
        """Make `node` go bus-off; it recovers after 128 runs of 11 recessive bits."""
        self._state = core.switch_off(self._state, self._number(node))

    # --- figures ---------------------------------------------------------------------------------------

    def counters(self, node: str) -> ErrorCounters:
        """The node's error counters, which determine its error state."""
        return self._state.nodes[self._number(node)].counters

    @property
    def figures(self) -> BusFigures:
        """The transmissions so far; a frame in transmission counts from its start."""
        state = self._state
        lost = sum(node.lost for node in state.nodes)
        return BusFigures(state.frames, state.errors, state.busy_bits * self._bit_ns, lost)

    # --- time ------------------------------------------------------------------------------------------

    def _number(self, node: str) -> int:
        number = self._numbers.get(node)
        if number is None:
            raise ValueError(f"no node {node!r} on this bus; it has {', '.join(self._names)}")
        return number

    def _advance(self, until_ns: int) -> None:
        until_bit = -(-until_ns // self._bit_ns)
        if until_bit < self._state.now_bit:
            raise ValueError(
                f"time {until_ns} ns, but the bus has already reached "
                f"{self._state.now_bit * self._bit_ns} ns; call it in the order of time"
            )
        self._state, arrivals = core.advance(self._state, until_bit)
        self._under_way += map(self._delivery, arrivals)

    def _delivery(self, arrival: Arrival) -> Delivery:
        receivers = self._receivers.get(arrival.receivers)
        if receivers is None:
            receivers = tuple(self._names[number] for number in arrival.receivers)
            self._receivers[arrival.receivers] = receivers
        return Delivery(
            arrival.bit * self._bit_ns,
            self._names[arrival.senders[0]],
            arrival.pending.frame,
            receivers,
        )


class ModelledNode(Inbox):
    """One node's connection."""

    def __init__(self, bus: ModelledBus, name: str) -> None:
        super().__init__()
        self._bus = bus
        self._name = name

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames now; they leave in the order of their identifiers, the lowest first."""
        for frame in frames:
            self._bus.submit(self._name, frame, self._bus.t_ns)
