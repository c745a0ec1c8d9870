"""The trace of bus errors: a record at each change of an error counter."""

from typing import NamedTuple

from hil.can_model.fault_confinement import ErrorCounters, ErrorState


class NodeErrors(NamedTuple):
    """One node's error counters and error state."""

    transmit: int = 0
    receive: int = 0
    error_state: ErrorState = ErrorState.ERROR_ACTIVE


class BusErrorRecord(NamedTuple):
    """Transmissions destroyed up to `t_s`, which their senders repeat, and the nodes' error counters."""

    t_s: float
    destroyed: int
    plant: NodeErrors
    firmware: NodeErrors
    operator: NodeErrors


def errors_of(counters: ErrorCounters) -> NodeErrors:
    """The record of one node."""
    return NodeErrors(counters.transmit, counters.receive, counters.error_state)
