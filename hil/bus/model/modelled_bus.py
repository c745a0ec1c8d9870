"""The bus model for named nodes and times in nanoseconds: submit frames, collect delivered frames.

It counts in whole bit times. A frame starts when the bus is idle, the lowest identifier among the nodes'
first frames wins, and a started frame is not interrupted. If two nodes send frames with the same identifier,
the node that sends recessive where they differ first is overruled: a bit error, since arbitration is over.
Equal frames merge (ISO 11898-1).

Simplifications: all nodes share one bit grid; there are no overload and no remote frames; a node that is
switched off while its frame is on the wire completes the frame. A destroyed transmission takes the time of
the whole frame and of the longest error frame, whatever bit was wrong: the cost of an error in the
response-time analysis (`hil.bus.model.schedulability`).
"""

from bisect import insort
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple

from firmware_py.interface.frame import Frame
from hil.bus.in_process import Inbox
from hil.bus.model.bits import (
    ERROR_FRAME_BITS,
    INTERMISSION_BITS,
    RECESSIVE_TAIL_BITS,
    SUSPEND_BITS,
    bit_ns_of,
    frame_bits,
)
from hil.bus.model.fault_confinement import (
    OFF_FROM,
    RECOVERY_RUN_BITS,
    RECOVERY_SEQUENCES,
    UNTOUCHED,
    ErrorCounters,
    ErrorState,
    after_missing_acknowledgement,
    after_receive_error,
    after_receiving,
    after_transmit_error,
    after_transmitting,
)

QUEUE_FRAMES = 64
"""Largest number of frames queued in a node's driver and controller; a further frame is lost."""


class Delivery(NamedTuple):
    """A frame that has ended; a second node that sent the same bits at once is not among the receivers."""

    t_ns: int
    sender: str
    frame: Frame
    receivers: tuple[str, ...]


class Pending(NamedTuple):
    """A queued frame; frames sort by identifier, then by age."""

    can_id: int
    number: int
    frame: Frame
    bits: int


class ModelledNode(Inbox):
    """One node and its connection: its transmit queue, its error counters, and when it may send."""

    def __init__(self, bus: "ModelledBus", name: str) -> None:
        super().__init__()
        self._bus = bus
        self.name = name
        self.queue: list[Pending] = []
        """Its frames in order of priority."""
        self.counters = UNTOUCHED
        self.silent_until_bit = 0
        self.sequences_left = 0
        """Runs of 11 recessive bits that a bus-off node still has to see; 0: the node is on the bus."""
        self.counting_from_bit = 0
        self.lost = 0
        """Frames lost because the queue was full or the node bus-off."""

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Queue frames now; they leave in the order of their identifiers, the lowest first."""
        for frame in frames:
            self._bus.submit(self.name, frame, self._bus.t_ns)

    @property
    def error_state(self) -> ErrorState:
        """The error state by the node's counters."""
        return self.counters.error_state

    def is_at_rest(self, sends: bool) -> bool:
        """Whether nothing waits and its error counters stay; `sends`: whether it will send frames."""
        is_ready = self.silent_until_bit * self._bus.bit_ns <= self._bus.t_ns and not self.sequences_left
        counted = self.counters.receive + (self.counters.transmit if sends else 0)
        return is_ready and not self.queue and not counted

    def switch_off(self, counting_from_bit: int) -> None:
        """Go bus-off with an empty queue, and count recessive bits from `counting_from_bit` on."""
        self.counters = ErrorCounters(max(self.counters.transmit, OFF_FROM), self.counters.receive)
        self.sequences_left = RECOVERY_SEQUENCES
        self.counting_from_bit = counting_from_bit
        self.lost += len(self.queue)
        self.queue.clear()

    def count_recessive_run(self, from_bit: int, to_bit: int, has_ended: bool) -> None:
        """Count a run of recessive bits of the bus, which may go on; recover if it is sufficient."""
        from_bit = max(from_bit, self.counting_from_bit)
        seen = max(to_bit - from_bit, 0) // RECOVERY_RUN_BITS
        if seen >= self.sequences_left:
            self.silent_until_bit = from_bit + self.sequences_left * RECOVERY_RUN_BITS
            self.counters, self.sequences_left = UNTOUCHED, 0
        elif has_ended:
            self.sequences_left -= seen

    def rest_after(self, idle_from_bit: int) -> None:
        """After a transmission: by the new counters go bus-off, suspend for a while, or be ready."""
        if self.error_state is ErrorState.BUS_OFF:
            self.switch_off(counting_from_bit=0)
        elif self.error_state is ErrorState.ERROR_PASSIVE:
            self.silent_until_bit = idle_from_bit + SUSPEND_BITS


class ModelledBus:
    """A deterministic CAN bus of named nodes.

    Time only moves forward: a frame takes part in every arbitration from its submission on.
    """

    def __init__(self, nodes: Sequence[str], bitrate: int = 1_000_000) -> None:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node names {list(nodes)}; wanted each once")
        self.bit_ns = bit_ns_of(bitrate)
        """The duration of a bit."""
        self._nodes = {name: ModelledNode(self, name) for name in nodes}
        self._under_way: list[Delivery] = []
        self._destroyed_ids: frozenset[int] = frozenset()
        self._now_bit = 0
        """All frames that start before it are computed."""
        self._idle_from_bit = 0
        self._recessive_from_bit = 0
        """Start of the run of recessive bits that ends with the next frame."""
        self._queued = 0
        self.destroyed = 0
        """Transmissions that have failed so far; one under way counts from its start."""
        self.t_ns = 0
        """The time at which frames of joined nodes are queued, set by `move_to`."""

    def submit(self, node: str, frame: Frame, t_ns: int) -> None:
        """Queue `frame` at `node`; it is lost if the node is bus-off or its queue full."""
        sender = self.join(node)
        self._advance(t_ns)
        if sender.sequences_left or len(sender.queue) >= QUEUE_FRAMES:
            sender.lost += 1
            return
        insort(sender.queue, Pending(frame.can_id, self._queued, frame, frame_bits(frame)))
        self._queued += 1

    def deliver(self, until_ns: int) -> list[Delivery]:
        """Return the frames that have arrived since the last call and not after `until_ns`, in order."""
        self._advance(until_ns)
        arrived = self._under_way
        self._under_way = []
        while arrived and arrived[-1].t_ns > until_ns:
            self._under_way.insert(0, arrived.pop())
        return arrived

    def join(self, node: str) -> ModelledNode:
        """The connection of one of the nodes."""
        if node not in self._nodes:
            raise ValueError(f"no node {node!r} on this bus; it has {', '.join(self._nodes)}")
        return self._nodes[node]

    def move_to(self, t_ns: int) -> list[Delivery]:
        """Advance to `t_ns`; the nodes receive the frames that have arrived, which are returned."""
        self.t_ns = t_ns
        deliveries = self.deliver(t_ns)
        for delivery in deliveries:
            for name in delivery.receivers:
                self._nodes[name].pending.append(delivery.frame)
        return deliveries

    # --- faults: each acts from the time of the last call on -----------------------------------------

    def destroy(self, can_ids: Collection[int]) -> None:
        """Destroy every transmission with one of these identifiers, and of no other."""
        self._destroyed_ids = frozenset(can_ids)

    def switch_off(self, node: str) -> None:
        """Make `node` go bus-off; it recovers after 128 runs of 11 recessive bits."""
        self.join(node).switch_off(self._now_bit)

    # --- figures ---------------------------------------------------------------------------------------

    def counters(self, node: str) -> ErrorCounters:
        """The node's error counters, which determine its error state."""
        return self.join(node).counters

    def is_at_rest(self, silent: Collection[str]) -> bool:
        """Whether the bus is idle, no frame waits, and the counters stay if all nodes but `silent` send."""
        return (
            not self._under_way
            and self._idle_from_bit * self.bit_ns <= self.t_ns
            and all(node.is_at_rest(name not in silent) for name, node in self._nodes.items())
        )

    # --- time ------------------------------------------------------------------------------------------

    def _advance(self, until_ns: int) -> None:
        """Compute the transmissions that start before `until_ns`, even if they end later."""
        until_bit = -(-until_ns // self.bit_ns)
        if until_bit < self._now_bit:
            raise ValueError(
                f"time {until_ns} ns, but the bus has already reached "
                f"{self._now_bit * self.bit_ns} ns; call it in the order of time"
            )
        if until_bit == self._now_bit:
            return
        while (start_bit := self._next_start()) is not None and start_bit < until_bit:
            self._transmit(start_bit)
        self._count_recessive_run(until_bit, has_ended=False)
        self._now_bit = until_bit

    def _next_start(self) -> int | None:
        """Start bit of the next frame if no further frame is queued; None if all queues are empty."""
        ready_bits = [node.silent_until_bit for node in self._nodes.values() if node.queue]
        return max(min(ready_bits), self._idle_from_bit, self._now_bit) if ready_bits else None

    def _count_recessive_run(self, to_bit: int, has_ended: bool) -> None:
        """Let the bus-off nodes count the present run of recessive bits up to `to_bit`."""
        for node in self._nodes.values():
            if node.sequences_left:
                node.count_recessive_run(self._recessive_from_bit, to_bit, has_ended)

    def _transmit(self, start_bit: int) -> None:
        """Let the nodes that are ready at `start_bit` send: one frame, which arrives or is destroyed."""
        ready = [node for node in self._nodes.values() if node.queue and node.silent_until_bit <= start_bit]
        can_id = min(node.queue[0].can_id for node in ready)
        senders = [node for node in ready if node.queue[0].can_id == can_id]
        winners = find_dominant(senders)
        overruled = [node for node in senders if node not in winners]
        self._count_recessive_run(start_bit, has_ended=True)
        receivers = [node for node in self._nodes.values() if node not in senders and not node.sequences_left]
        # An error-passive node that is overruled cannot destroy the other's frame: its flag is recessive.
        bit_errors = any(node.error_state is ErrorState.ERROR_ACTIVE for node in overruled)
        destroyed = bit_errors or can_id in self._destroyed_ids
        arrived = bool(receivers) and not destroyed
        pending = winners[0].queue[0]
        busy_bits = pending.bits if arrived else pending.bits + ERROR_FRAME_BITS
        self._now_bit = start_bit
        self._idle_from_bit = start_bit + busy_bits
        self._recessive_from_bit = self._idle_from_bit - RECESSIVE_TAIL_BITS
        self.destroyed += not arrived
        for node in receivers:
            node.counters = (after_receiving if arrived else after_receive_error)(node.counters)
        for node in senders:
            rule = after_transmit_error if node in overruled else rule_of_winners(arrived, destroyed)
            node.counters = rule(node.counters)
            if arrived and node in winners:
                node.queue.pop(0)
            node.rest_after(self._idle_from_bit)
        if arrived:
            t_ns = (self._idle_from_bit - INTERMISSION_BITS) * self.bit_ns
            names = tuple(node.name for node in receivers)
            self._under_way.append(Delivery(t_ns, winners[0].name, pending.frame, names))


def find_dominant(senders: Sequence[ModelledNode]) -> list[ModelledNode]:
    """The senders of one identifier whose frame is dominant where their frames differ first."""

    def levels(node: ModelledNode) -> tuple[int, bytes]:
        data = node.queue[0].frame.data
        return len(data), data  # in the order of the wire; a lower number is dominant first

    lowest = min(map(levels, senders))
    return [node for node in senders if levels(node) == lowest]


def rule_of_winners(arrived: bool, destroyed: bool) -> Callable[[ErrorCounters], ErrorCounters]:
    """The rule of fault confinement for the senders of a frame that was not overruled."""
    if arrived:
        return after_transmitting
    return after_transmit_error if destroyed else after_missing_acknowledgement
