"""The state of the bus model between two frames."""

from typing import NamedTuple

from firmware_py.interface.frame import Frame
from hil.can_model.fault_confinement import OFF_FROM, RECOVERY_SEQUENCES, ErrorCounters

UNTOUCHED = ErrorCounters()


class Pending(NamedTuple):
    """A frame that waits; sorts by identifier, then by age."""

    can_id: int
    number: int
    queued_bit: int
    frame: Frame
    bits: int


class Corruption(NamedTuple):
    """Transmissions that a disturbance destroys, repetitions counted too.

    Of the transmissions with `can_id`, or of all, `skip` pass and the next `hits` are hit: `bit` bits after
    their arbitration, or at the last bit of the frame if it is shorter. Hit in that last bit, a frame counts
    for its receivers but not for its sender, and comes twice. Only the node `seen_by` sees it, where one is
    named: it finds the checksum wrong, whatever the bit.
    """

    can_id: int | None = None
    skip: int = 0
    hits: int = 1
    bit: int = 0
    seen_by: int | None = None


class NodeState(NamedTuple):
    """One node: its transmit queue in order of priority, its error counters, and when it may send."""

    queue: tuple[Pending, ...] = ()
    counters: ErrorCounters = UNTOUCHED
    silent_until_bit: int = 0
    sequences_left: int = 0
    """Runs of recessive bits that a node which is off still has to see; 0: it is on the bus."""
    counting_from_bit: int = 0
    lost: int = 0
    """Frames refused or thrown away: queue full or node off."""


class BusState(NamedTuple):
    """The bus: everything that starts before `now_bit` is decided."""

    nodes: tuple[NodeState, ...]
    now_bit: int = 0
    idle_from_bit: int = 0
    recessive_from_bit: int = 0
    """Start of the run of recessive bits that ends with the next frame."""
    corruptions: tuple[Corruption, ...] = ()
    queued: int = 0
    frames: int = 0
    """Transmissions that went through."""
    errors: int = 0
    """Transmissions that did not, or not for all."""
    busy_bits: int = 0


class Arrival(NamedTuple):
    """A frame at its end: which nodes have sent it (more than one: the same bits at the same time), and which
    have received it."""

    bit: int
    senders: tuple[int, ...]
    receivers: tuple[int, ...]
    pending: Pending
    complete: bool = True
    """Whether the senders know; if not, they repeat it."""


def with_node(state: BusState, number: int, node: NodeState) -> BusState:
    """Return the state with one node replaced."""
    return state._replace(nodes=(*state.nodes[:number], node, *state.nodes[number + 1 :]))


def switched_off(node: NodeState, counting_from_bit: int) -> NodeState:
    """Return the node bus-off: its queue is thrown away, and it counts recessive bits from then on."""
    counters = ErrorCounters(max(node.counters.transmit, OFF_FROM), node.counters.receive)
    return node._replace(
        queue=(),
        counters=counters,
        sequences_left=RECOVERY_SEQUENCES,
        counting_from_bit=counting_from_bit,
        lost=node.lost + len(node.queue),
    )
