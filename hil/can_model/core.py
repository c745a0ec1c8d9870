"""The bus model as pure functions of its state: queue a frame, advance the time in whole bit times.

A frame starts when the bus is idle, the lowest identifier among the nodes' first frames wins, and a started
frame is not interrupted. `advance` computes all frames that start before a given time, and `queue` adds
frames at that time. Nodes have numbers.

Simplifications: all nodes share one bit grid; there are no overload and no remote frames; a node that is
switched off while its frame is on the wire completes the frame; every error takes its worst-case time.
"""

from bisect import bisect

from firmware_py.interface.frame import Frame
from hil.can_model.bits import frame_bits
from hil.can_model.fault_confinement import RECOVERY_RUN_BITS
from hil.can_model.state import Arrival, BusState, NodeState, Pending, switched_off, with_node
from hil.can_model.transmission import transmit

ABOVE_ALL_IDS = 0x800


def queue(state: BusState, node: int, frame: Frame, depth: int) -> BusState:
    """Return the state with `frame` queued at `node` now; a node's queue holds at most `depth` frames."""
    sender = state.nodes[node]
    if sender.sequences_left or len(sender.queue) >= depth:
        return with_node(state, node, sender._replace(lost=sender.lost + 1))
    pending = Pending(frame.can_id, state.queued, state.now_bit, frame, frame_bits(frame))
    place = bisect(sender.queue, pending)
    waiting = (*sender.queue[:place], pending, *sender.queue[place:])
    nodes = (*state.nodes[:node], sender._replace(queue=waiting), *state.nodes[node + 1 :])
    return state._replace(nodes=nodes, queued=state.queued + 1)


def advance(state: BusState, until_bit: int) -> tuple[BusState, list[Arrival]]:
    """Advance to `until_bit`; return the frames that start before it, even if they end later."""
    arrivals: list[Arrival] = []
    if until_bit == state.now_bit:  # all frames that start before it are computed
        return state, arrivals
    while True:
        start_bit = _next_start(state)
        if start_bit is None or start_bit >= until_bit:
            break
        state, arrival = _transmit(state, start_bit)
        if arrival is not None:
            arrivals.append(arrival)
    if any(node.sequences_left for node in state.nodes):
        state = state._replace(nodes=_recovered(state, until_bit))
    return state._replace(now_bit=max(state.now_bit, until_bit)), arrivals


def switch_off(state: BusState, node: int) -> BusState:
    """Return the state with `node` bus-off from now on; it recovers as from bus-off by its own errors."""
    return with_node(state, node, switched_off(state.nodes[node], state.now_bit))


# --- starting ------------------------------------------------------------------------------------------


def _next_start(state: BusState) -> int | None:
    """Start bit of the next frame if no further frame is queued; None if all queues are empty."""
    earliest: int | None = None
    for node in state.nodes:
        if node.queue and (earliest is None or node.silent_until_bit < earliest):
            earliest = node.silent_until_bit
    if earliest is None:
        return None
    return max(earliest, state.idle_from_bit, state.now_bit)


def _recovered(state: BusState, at_bit: int) -> tuple[NodeState, ...]:
    """The nodes after the recessive bits up to `at_bit`; bus-off nodes recover if these are sufficient."""
    nodes = list(state.nodes)
    for number, node in enumerate(nodes):
        if not node.sequences_left:
            continue
        from_bit = max(state.recessive_from_bit, node.counting_from_bit)
        sequences = max(at_bit - from_bit, 0) // RECOVERY_RUN_BITS
        if sequences >= node.sequences_left:
            back_bit = from_bit + node.sequences_left * RECOVERY_RUN_BITS
            nodes[number] = NodeState(silent_until_bit=back_bit, lost=node.lost)
    return tuple(nodes)


def _counted(state: BusState, start_bit: int) -> tuple[NodeState, ...]:
    """The nodes at a start bit, with the runs of 11 recessive bits before it counted for bus-off nodes."""
    nodes = list(_recovered(state, start_bit))
    for number, node in enumerate(nodes):
        if node.sequences_left:
            from_bit = max(state.recessive_from_bit, node.counting_from_bit)
            seen = max(start_bit - from_bit, 0) // RECOVERY_RUN_BITS
            nodes[number] = node._replace(sequences_left=node.sequences_left - seen)
    return tuple(nodes)


def _transmit(state: BusState, start_bit: int) -> tuple[BusState, Arrival | None]:
    """Return the state after the frame that starts at `start_bit`, and the frame if a node received it."""
    can_id = ABOVE_ALL_IDS
    senders: list[int] = []
    for number, node in enumerate(state.nodes):
        if node.queue and node.silent_until_bit <= start_bit:
            first = node.queue[0].can_id
            if first < can_id:
                can_id, senders = first, [number]
            elif first == can_id:
                senders.append(number)
    if any(node.sequences_left for node in state.nodes):
        state = state._replace(nodes=_counted(state, start_bit))
    return transmit(state, start_bit, senders)
