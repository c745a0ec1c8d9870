"""One transmission in full: several senders, disturbances, missing acknowledgement, and error counters.

ISO 11898-1. If two nodes send frames with the same identifier, the node that sends recessive is overruled in
the first bit in which the frames differ. This is a bit error, since arbitration is over. Equal frames merge.
"""

from collections.abc import Sequence
from typing import NamedTuple

from hil.can_model import errors_on_the_wire as wire
from hil.can_model.bits import INTERMISSION_BITS, TAIL_BITS, wire_bits
from hil.can_model.fault_confinement import (
    ErrorCounters,
    ErrorState,
    after_missing_acknowledgement,
    after_receive_error,
    after_receiving,
    after_transmit_error,
    after_transmitting,
)
from hil.can_model.state import Arrival, BusState, Corruption, NodeState, Pending, switched_off


class Parts(NamedTuple):
    """The nodes' roles in one transmission."""

    nodes: tuple[NodeState, ...]
    senders: tuple[int, ...]
    receivers: tuple[int, ...]

    def pending(self, number: int) -> Pending:
        """The frame that a sender sends."""
        return self.nodes[number].queue[0]

    def any_active(self, numbers: Sequence[int]) -> bool:
        """Whether an error flag of one of these nodes would be dominant."""
        return any(self.nodes[number].counters.error_state is ErrorState.ERROR_ACTIVE for number in numbers)

    def transmit_errors(self, numbers: Sequence[int]) -> dict[int, ErrorCounters]:
        """Counters of senders that have signalled an error."""
        return {number: after_transmit_error(self.nodes[number].counters) for number in numbers}

    def receive_errors(self, first: int | None = None) -> dict[int, ErrorCounters]:
        """Counters of all receivers after an error that `first` has signalled before the others."""
        return {
            number: after_receive_error(self.nodes[number].counters, number == first)
            for number in self.receivers
        }


class Failure(NamedTuple):
    """An error: the bit of the frame in which it is detected first, and the length of all flags after it."""

    bit: int
    flag_bits: int
    dominant: bool = True
    """Whether at least one of the flags is dominant."""


class Outcome(NamedTuple):
    """The outcome of a transmission."""

    failure: Failure | None
    counters: dict[int, ErrorCounters]
    """New counters of the nodes concerned."""
    received_by: tuple[int, ...] = ()


def transmit(state: BusState, start_bit: int, senders: Sequence[int]) -> tuple[BusState, Arrival | None]:
    """Return the state after the frame that `senders` start at `start_bit`, and the frame if it arrived."""
    everyone = Parts(
        state.nodes,
        tuple(senders),
        tuple(
            number
            for number, node in enumerate(state.nodes)
            if number not in senders and not node.sequences_left
        ),
    )
    collision, parts = _who_sends(everyone)
    if collision is not None:
        return _settled(state, start_bit, everyone, parts, collision)
    hit, corruptions = _next_corruption(state.corruptions, parts.pending(parts.senders[0]).can_id)
    outcome = _outcome(parts, hit)
    return _settled(state._replace(corruptions=corruptions), start_bit, everyone, parts, outcome)


def _who_sends(everyone: Parts) -> tuple[Outcome | None, Parts]:
    """Resolve a collision of senders with the same identifier; return its outcome and the remaining senders.

    The outcome is None if the frame is not destroyed: an overruled sender that is error-passive cannot
    destroy the frame of the other.
    """
    parts = everyone
    while len({parts.pending(number).frame for number in parts.senders}) > 1:
        wires = {number: wire_bits(parts.pending(number).frame) for number in parts.senders}
        bit = wire.first_difference([*wires.values()])
        losers = tuple(number for number in parts.senders if wires[number][bit] == wire.RECESSIVE)
        winners = tuple(number for number in parts.senders if wires[number][bit] == wire.DOMINANT)
        if parts.any_active(losers):
            delays = [
                wire.bits_to_contradiction(wires[number], bit)
                for number in winners
                if parts.any_active([number])
            ]
            if parts.any_active(parts.receivers):
                delays.append(wire.answer_delay(wires[winners[0]][: bit + 1], wire.DOMINANT))
            counters = parts.transmit_errors(parts.senders) | parts.receive_errors()
            return Outcome(Failure(bit, wire.signalling_bits(delays)), counters), parts
        parts = parts._replace(senders=winners)
    return None, parts


def _next_corruption(
    corruptions: Sequence[Corruption], can_id: int
) -> tuple[Corruption | None, tuple[Corruption, ...]]:
    """Return the disturbance of a frame with `can_id`, if any, and the disturbances left for later frames."""
    hit: Corruption | None = None
    left: list[Corruption] = []
    for corruption in corruptions:
        if corruption.can_id not in (None, can_id):
            left.append(corruption)
        elif corruption.skip > 0:
            left.append(corruption._replace(skip=corruption.skip - 1))
        else:
            hit = hit or corruption
            if corruption.hits > 1:
                left.append(corruption._replace(hits=corruption.hits - 1))
    return hit, tuple(left)


def _outcome(parts: Parts, hit: Corruption | None) -> Outcome:
    """Return the outcome of a frame whose senders all send the same bits."""
    if hit is not None and hit.seen_by is None:
        return _disturbed(parts, hit.bit)
    affected = hit.seen_by if hit is not None and hit.seen_by in parts.receivers else None
    acknowledging = tuple(number for number in parts.receivers if number != affected)
    if not acknowledging:
        return _unacknowledged(parts, affected)
    if affected is not None and parts.any_active([affected]):
        return _refused(parts, affected)
    counters = parts.receive_errors()  # all but those of the affected node are overwritten
    counters |= {number: after_receiving(parts.nodes[number].counters) for number in acknowledging}
    counters |= {number: after_transmitting(parts.nodes[number].counters) for number in parts.senders}
    return Outcome(None, counters, acknowledging)


def _disturbed(parts: Parts, bits_after_arbitration: int) -> Outcome:
    """A bit is inverted for all nodes: its sender detects the bit error at once."""
    frame = parts.pending(parts.senders[0]).frame
    bit = wire.disturbed_bit(frame, bits_after_arbitration)
    seen = wire.seen_when_disturbed(frame, bit)
    sent_dominant, answered = parts.any_active(parts.senders), parts.any_active(parts.receivers)
    delays = (
        [wire.answer_delay(seen, wire.DOMINANT if sent_dominant else wire.RECESSIVE)]
        if seen and answered
        else []
    )
    failure = Failure(bit, wire.signalling_bits(delays), sent_dominant or answered)
    counters = parts.transmit_errors(parts.senders)
    if bit == len(wire_bits(frame)) + TAIL_BITS - 1:
        # The frame was valid for its receivers one bit before; for them this is an overload, no error.
        counters |= {number: after_receiving(parts.nodes[number].counters) for number in parts.receivers}
        return Outcome(failure, counters, parts.receivers)
    return Outcome(failure, counters | parts.receive_errors())


def _unacknowledged(parts: Parts, affected: int | None) -> Outcome:
    """No receiver acknowledges the frame: there is none, or the only one has received it with an error."""
    bit = len(wire_bits(parts.pending(parts.senders[0]).frame)) + wire.ACKNOWLEDGEMENT_SLOT
    answered = affected is not None and parts.any_active([affected])
    dominant = answered or parts.any_active(parts.senders)
    failure = Failure(bit, wire.signalling_bits([1] if answered else []), dominant)
    charged = {
        number: after_missing_acknowledgement(parts.nodes[number].counters, dominant)
        for number in parts.senders
    }
    return Outcome(failure, charged | parts.receive_errors())


def _refused(parts: Parts, affected: int) -> Outcome:
    """One receiver finds the checksum wrong, and signals the error after the others' acknowledgement."""
    bit = len(wire_bits(parts.pending(parts.senders[0]).frame)) + wire.ACKNOWLEDGEMENT_DELIMITER
    others = [number for number in (*parts.senders, *parts.receivers) if number != affected]
    answered = parts.any_active(others)
    counters = parts.transmit_errors(parts.senders) | parts.receive_errors(affected if answered else None)
    return Outcome(Failure(bit, wire.signalling_bits([1] if answered else [])), counters)


def _settled(
    state: BusState, start_bit: int, everyone: Parts, parts: Parts, outcome: Outcome
) -> tuple[BusState, Arrival | None]:
    """Return the state when the bus is idle again, and the frame if a node has received it."""
    pending = parts.pending(parts.senders[0])
    failure = outcome.failure
    if failure is None:
        idle_from_bit = start_bit + pending.bits
        arrival_bit = idle_from_bit - INTERMISSION_BITS
    else:
        arrival_bit = start_bit + failure.bit + 1
        idle_from_bit = arrival_bit + failure.flag_bits + wire.DELIMITER_BITS + INTERMISSION_BITS
    recessive_from_bit = idle_from_bit - wire.RECESSIVE_TAIL_BITS
    if failure is not None and not failure.dominant:
        recessive_from_bit = start_bit + failure.bit + 1

    overruled = [number for number in everyone.senders if number not in parts.senders]
    nodes = list(state.nodes)
    for number, new in (outcome.counters | parts.transmit_errors(overruled)).items():
        nodes[number] = nodes[number]._replace(counters=new)
    for number in everyone.senders:
        node = nodes[number]
        if failure is None and number in parts.senders:
            node = node._replace(queue=node.queue[1:])
        nodes[number] = _rested(node, idle_from_bit)

    after = state._replace(
        nodes=tuple(nodes),
        now_bit=start_bit,
        idle_from_bit=idle_from_bit,
        recessive_from_bit=recessive_from_bit,
        frames=state.frames + (failure is None),
        errors=state.errors + (failure is not None),
        busy_bits=state.busy_bits + idle_from_bit - start_bit,
    )
    if not outcome.received_by:
        return after, None
    return after, Arrival(arrival_bit, parts.senders, outcome.received_by, pending, failure is None)


def _rested(node: NodeState, idle_from_bit: int) -> NodeState:
    """Return a sender after its frame: by its new counters bus-off, suspended for a while, or ready."""
    error_state = node.counters.error_state
    if error_state is ErrorState.BUS_OFF:
        return switched_off(node, counting_from_bit=0)
    if error_state is ErrorState.ERROR_PASSIVE:
        return node._replace(silent_until_bit=idle_from_bit + wire.SUSPEND_BITS)
    return node
