"""One transmission with all its cases: equal identifiers, disturbances, no acknowledgement, error counters.

ISO 11898-1. If two nodes send frames with the same identifier, the node that sends recessive where they
differ first is overruled. This is a bit error, since arbitration is over. Equal frames merge.

A destroyed transmission takes the time of the whole frame and of the longest error frame, whatever bit was
wrong. This is the cost of an error in the response-time analysis (`hil.can_model.schedulability`).
"""

from collections.abc import Sequence

from hil.can_model.bits import ERROR_FRAME_BITS, INTERMISSION_BITS, RECESSIVE_TAIL_BITS, SUSPEND_BITS
from hil.can_model.fault_confinement import (
    ErrorState,
    after_missing_acknowledgement,
    after_receive_error,
    after_receiving,
    after_transmit_error,
    after_transmitting,
)
from hil.can_model.state import Arrival, BusState, Corruption, NodeState, switched_off


def transmit(state: BusState, start_bit: int, senders: Sequence[int]) -> tuple[BusState, Arrival | None]:
    """Return the state after the frame that `senders` start at `start_bit`, and the frame if it arrived."""
    before = state.nodes
    winners, overruled = _overrule(before, senders) if len(senders) > 1 else (tuple(senders), ())
    receivers = tuple(
        number for number, node in enumerate(before) if number not in senders and not node.sequences_left
    )
    pending = before[winners[0]].queue[0]
    # An error-passive node that is overruled cannot destroy the frame of the other: its flag is recessive.
    destroyed = any(before[number].counters.error_state is ErrorState.ERROR_ACTIVE for number in overruled)
    corruptions = state.corruptions
    if corruptions and not destroyed:
        destroyed, corruptions = _next_corruption(corruptions, pending.can_id)
    arrived = not destroyed and bool(receivers)
    busy_bits = pending.bits if arrived else pending.bits + ERROR_FRAME_BITS
    idle_from_bit = start_bit + busy_bits

    after_sending = after_transmitting if arrived else after_missing_acknowledgement
    at_senders = after_transmit_error if destroyed else after_sending
    at_receivers = after_receiving if arrived else after_receive_error
    nodes = list(before)
    for number in receivers:
        counters = at_receivers(before[number].counters)
        if counters != before[number].counters:
            nodes[number] = before[number]._replace(counters=counters)
    for number in senders:
        node = before[number]
        rule = at_senders if number in winners else after_transmit_error
        queue = node.queue[1:] if arrived and number in winners else node.queue
        nodes[number] = _rest(node._replace(counters=rule(node.counters), queue=queue), idle_from_bit)
    after = BusState(
        nodes=tuple(nodes),
        now_bit=start_bit,
        idle_from_bit=idle_from_bit,
        recessive_from_bit=idle_from_bit - RECESSIVE_TAIL_BITS,
        corruptions=corruptions,
        queued=state.queued,
        frames=state.frames + arrived,
        errors=state.errors + (not arrived),
        busy_bits=state.busy_bits + busy_bits,
    )
    arrival = Arrival(idle_from_bit - INTERMISSION_BITS, winners, receivers, pending)
    return after, arrival if arrived else None


def _overrule(nodes: Sequence[NodeState], senders: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The senders whose frame is dominant where the frames of one identifier differ first, and the others."""

    def levels(number: int) -> tuple[int, bytes]:
        data = nodes[number].queue[0].frame.data
        return len(data), data  # in the order of the wire; a lower number is dominant first

    lowest = min(map(levels, senders))
    winners = tuple(number for number in senders if levels(number) == lowest)
    return winners, tuple(number for number in senders if number not in winners)


def _next_corruption(corruptions: Sequence[Corruption], can_id: int) -> tuple[bool, tuple[Corruption, ...]]:
    """Whether a frame with `can_id` is destroyed, and the disturbances left for later frames."""
    for index, corruption in enumerate(corruptions):
        if corruption.can_id in (None, can_id):
            left = [corruption._replace(hits=corruption.hits - 1)] if corruption.hits > 1 else []
            return True, (*corruptions[:index], *left, *corruptions[index + 1 :])
    return False, tuple(corruptions)


def _rest(node: NodeState, idle_from_bit: int) -> NodeState:
    """Return a sender after its frame: by its new counters bus-off, suspended for a while, or ready."""
    error_state = node.counters.error_state
    if error_state is ErrorState.BUS_OFF:
        return switched_off(node, counting_from_bit=0)
    if error_state is ErrorState.ERROR_PASSIVE:
        return node._replace(silent_until_bit=idle_from_bit + SUSPEND_BITS)
    return node
