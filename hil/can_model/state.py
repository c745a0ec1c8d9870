"""The state of the bus model between two frames."""

from typing import NamedTuple

from firmware_py.interface.frame import Frame
from hil.can_model.fault_confinement import OFF_FROM, RECOVERY_SEQUENCES, ErrorCounters

UNTOUCHED = ErrorCounters()


class Pending(NamedTuple):
    """A queued frame; frames sort by identifier, then by age."""

    can_id: int
    number: int
    queued_bit: int
    frame: Frame
    bits: int


class Corruption(NamedTuple):
    """A disturbance that destroys the next `hits` transmissions with `can_id` (None: of all frames).

    A repetition counts as a further transmission.
    """

    can_id: int | None = None
    hits: int = 1


class NodeState(NamedTuple):
    """One node: its transmit queue in order of priority, its error counters, and when it may send."""

    queue: tuple[Pending, ...] = ()
    counters: ErrorCounters = UNTOUCHED
    silent_until_bit: int = 0
    sequences_left: int = 0
    """Runs of 11 recessive bits that a bus-off node still has to see; 0: the node is on the bus."""
    counting_from_bit: int = 0
    lost: int = 0
    """Frames lost because the queue was full or the node bus-off."""


class BusState(NamedTuple):
    """The state of the bus; all frames that start before `now_bit` are computed."""

    nodes: tuple[NodeState, ...]
    now_bit: int = 0
    idle_from_bit: int = 0
    recessive_from_bit: int = 0
    """Start of the run of recessive bits that ends with the next frame."""
    corruptions: tuple[Corruption, ...] = ()
    queued: int = 0
    frames: int = 0
    """Transmissions without error."""
    errors: int = 0
    """Transmissions that failed."""
    busy_bits: int = 0


class Arrival(NamedTuple):
    """A frame that has ended, its senders (several if they sent equal frames at once) and its receivers."""

    bit: int
    senders: tuple[int, ...]
    receivers: tuple[int, ...]
    pending: Pending


def with_node(state: BusState, number: int, node: NodeState) -> BusState:
    """Return the state with one node replaced."""
    return state._replace(nodes=(*state.nodes[:number], node, *state.nodes[number + 1 :]))


def switched_off(node: NodeState, counting_from_bit: int) -> NodeState:
    """Return the node bus-off, with an empty queue; it counts recessive bits from `counting_from_bit` on."""
    counters = ErrorCounters(max(node.counters.transmit, OFF_FROM), node.counters.receive)
    return node._replace(
        queue=(),
        counters=counters,
        sequences_left=RECOVERY_SEQUENCES,
        counting_from_bit=counting_from_bit,
        lost=node.lost + len(node.queue),
    )
