"""Fault confinement of a CAN node: transmit and receive error counters, and its error state.

Bosch, "CAN Specification 2.0", 1991, part A, section 7 (Fault Confinement); ISO 11898-1. Where the standard
leaves room: a receive counter above 127 rises no further, and falls to 119 with the next frame received.
"""

from enum import IntEnum
from typing import NamedTuple

PASSIVE_FROM = 128
OFF_FROM = 256
RECEIVE_COUNTER_AFTER_PASSIVE = 119

RECOVERY_SEQUENCES = 128
RECOVERY_RUN_BITS = 11
"""A node that is off comes back after 128 runs of 11 recessive bits."""


class ErrorState(IntEnum):
    """The error state of a node (ISO 11898-1)."""

    ERROR_ACTIVE = 0
    """Everything; its error flags are dominant."""
    ERROR_PASSIVE = 1
    """Send and receive; its error flags are recessive, and after sending it waits for 8 bits more."""
    BUS_OFF = 2
    """Nothing."""


class ErrorCounters(NamedTuple):
    """One node's two counters."""

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


def after_transmitting(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a node whose frame went through."""
    return ErrorCounters(max(counters.transmit - 1, 0), counters.receive)


def after_transmit_error(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a sender that has sent an error flag."""
    return ErrorCounters(counters.transmit + 8, counters.receive)


def after_missing_acknowledgement(counters: ErrorCounters, flag_met_dominant: bool) -> ErrorCounters:
    """Return the counters of a sender that nobody has acknowledged.

    An error-passive one whose flag nobody answered is not punished, so a node that is alone on the bus never
    goes off.
    """
    if counters.error_state is ErrorState.ERROR_PASSIVE and not flag_met_dominant:
        return counters
    return after_transmit_error(counters)


def after_receiving(counters: ErrorCounters) -> ErrorCounters:
    """Return the counters of a node that has received a frame."""
    if counters.receive >= PASSIVE_FROM:
        return ErrorCounters(counters.transmit, RECEIVE_COUNTER_AFTER_PASSIVE)
    return ErrorCounters(counters.transmit, max(counters.receive - 1, 0))


def after_receive_error(counters: ErrorCounters, first_to_signal: bool) -> ErrorCounters:
    """Return the counters of a receiver that has seen an error.

    The first to signal it sees the others' flags follow its own and is punished harder: the error is
    probably its own.
    """
    if counters.receive >= PASSIVE_FROM:
        return counters
    return ErrorCounters(counters.transmit, counters.receive + (9 if first_to_signal else 1))
