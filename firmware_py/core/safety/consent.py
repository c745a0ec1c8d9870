"""The operator's consent: which of the requests that arrive counts.

    step(own, state, operator) -> state
    end(state) -> state                                    when READY, FAULT or E_STOP begins

IDLE counts at once. Another request counts only after the operator has changed to it within a sequence of
commands (to RUN and to the watchdog's test from IDLE alone) and has repeated it for `repeated_ticks`. An
operator that did not ask for it has sent a command meanwhile: one that continues the sequence and requests
something else, or one out of sequence. Either ends the request in its tick, in every mode, and so do silence
and `end`; afterwards only another change counts. So neither a recorded command nor a second sender starts
what the live operator did not ask for, or keeps up what it has ended.
"""

from typing import NamedTuple

from firmware_py.core.inputs import OperatorInput
from firmware_py.core.numbers import in_ticks
from firmware_py.core.safety import drive_link
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import OperatorRequest
from firmware_py.interface.generated.parameters import Parameters

ARMING_S = drive_link.SETTING_ROUNDS * drive_link.REPEAT_S
"""Shortest time from a request that counts to torque. A request is repeated for this much less than the
operator may be silent, the smallest time in which a live operator shows that it asks for something else."""


class Constants(NamedTuple):
    """How long the operator may be silent, and how long it repeats a request until this counts."""

    silent_ticks: int
    repeated_ticks: int


def derive(p: Parameters, limits: GateLimits) -> Constants:
    """The constants of these parameters."""
    repeated_ticks = in_ticks(p.watchdog.operator_s - ARMING_S, limits.tick_s, 1)
    return Constants(limits.operator_ticks, repeated_ticks)


class ConsentState(NamedTuple):
    """`request`: the one that counts, IDLE if there is none. `asked`: the newest command's in the sequence.

    `asked_ticks`: the time since the operator changed to it; −1: no change was seen that may count.
    """

    request: OperatorRequest
    asked: OperatorRequest
    asked_ticks: int


INITIAL = ConsentState(OperatorRequest.IDLE, OperatorRequest.CLEAR_FAULTS, -1)
"""Nothing was asked: no change from IDLE, nor one to CLEAR_FAULTS, can have been seen."""


def end(state: ConsentState) -> ConsentState:
    """The consent ends: what was asked so far counts no more."""
    return ConsentState(OperatorRequest.IDLE, state.asked, -1)


def step(own: Constants, state: ConsentState, operator: OperatorInput) -> ConsentState:
    """One tick."""
    if operator.stray_ticks == 0 or operator.age_ticks > own.silent_ticks:
        return INITIAL
    request, asked, asked_ticks = state.request, state.asked, state.asked_ticks
    if asked_ticks >= 0:
        asked_ticks = min(asked_ticks + 1, NEVER_TICKS)
    if operator.age_ticks == 0 and operator.request != asked:
        may_count = operator.request == OperatorRequest.CLEAR_FAULTS or asked == OperatorRequest.IDLE
        request, asked, asked_ticks = OperatorRequest.IDLE, operator.request, 0 if may_count else -1
    if operator.age_ticks == 0 and asked_ticks >= own.repeated_ticks:
        request = asked
    return ConsentState(request, asked, asked_ticks)
