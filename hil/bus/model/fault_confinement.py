"""Fault confinement of a CAN node: transmit and receive error counters, its error state, and their record.

Bosch, "CAN Specification 2.0", 1991, part A, section 7 (Fault Confinement); ISO 11898-1. Two values that the
standard leaves open: a receive counter above 127 rises no further, and the next received frame sets it to
119.
"""

from enum import IntEnum
from typing import NamedTuple

PASSIVE_FROM = 128
OFF_FROM = 256
RECEIVE_COUNTER_AFTER_PASSIVE = 119

RECOVERY_SEQUENCES = 128
RECOVERY_RUN_BITS = 11
"""A bus-off node recovers after 128 runs of 11 recessive bits."""


class ErrorState(IntEnum):
    """The error state of a node (ISO 11898-1)."""

    ERROR_ACTIVE = 0
    """The node sends and receives; its error flags are dominant."""
    ERROR_PASSIVE = 1
    """The node sends and receives; its error flags are recessive, and after sending it waits 8 more bits."""
    BUS_OFF = 2
    """The node neither sends nor receives."""


class ErrorCounters(NamedTuple):
    """A node's transmit and receive error counters."""

    transmit: int = 0
    receive: int = 0

    @property
    def error_state(self) -> ErrorState:
        """The error state for these counters."""
        if self.transmit >= OFF_FROM:
            return ErrorState.BUS_OFF
        if self.transmit >= PASSIVE_FROM or self.receive >= PASSIVE_FROM:
            return ErrorState.ERROR_PASSIVE
        return ErrorState.ERROR_ACTIVE


UNTOUCHED = ErrorCounters()
"""The counters of a node that has seen no error."""


def after_transmitting(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a node that has sent a frame without error."""
    return ErrorCounters(max(counters.transmit - 1, 0), counters.receive)


def after_transmit_error(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a sender that has sent an error flag."""
    return ErrorCounters(counters.transmit + 8, counters.receive)


def after_missing_acknowledgement(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a sender whose frame no node has acknowledged.

    Those of an error-passive sender do not change, so a node that is alone on the bus never goes bus-off.
    """
    if counters.error_state is ErrorState.ERROR_PASSIVE:
        return counters
    return after_transmit_error(counters)


def after_receiving(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a node that has received a frame."""
    if counters.receive >= PASSIVE_FROM:
        return ErrorCounters(counters.transmit, RECEIVE_COUNTER_AFTER_PASSIVE)
    return ErrorCounters(counters.transmit, max(counters.receive - 1, 0))


def after_receive_error(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a receiver that has seen an error of the sender."""
    return ErrorCounters(counters.transmit, min(counters.receive + 1, PASSIVE_FROM))


class NodeErrors(NamedTuple):
    """One node's error counters and error state."""

    transmit: int = 0
    receive: int = 0
    error_state: ErrorState = ErrorState.ERROR_ACTIVE


class BusErrorRecord(NamedTuple):
    """Transmissions destroyed up to `t_s`, which their senders repeat, and the nodes' error counters.

    `unsent`: frames that these nodes have discarded up to `t_s`, by a full transmit queue or while bus-off.
    """

    t_s: float
    destroyed: int
    unsent: int
    plant: NodeErrors
    firmware: NodeErrors
    operator: NodeErrors


RECORDED = BusErrorRecord._fields[3:]
"""The nodes whose errors are recorded."""


def errors_of(counters: ErrorCounters) -> NodeErrors:
    """The record of one node."""
    return NodeErrors(counters.transmit, counters.receive, counters.error_state)
