"""The firmware's mode and its reason: one pure transition function.

Nothing moves at power-up. INIT waits until every input is fresh and the drive has no error. READY waits until
the operator has requested IDLE, the drive has confirmed that its axis is idle, and the crank is slow enough
to be taken over; only then does a RUN request start the motor. A fault is latched with its first reason, and
so is an E-stop. Both are cleared only by a CLEAR_FAULTS that the operator sends afterwards, once the cause
has gone, and lead to INIT, so that all conditions of a start are checked again. Clearing never arms.
"""

from typing import NamedTuple

from firmware_py.core.records import zeroed
from firmware_py.core.safety.monitors import Findings
from firmware_py.interface.enums import (
    ASKS_CLEAR,
    ASKS_IDLE,
    ASKS_RUN,
    E_STOP,
    FAULT,
    INIT,
    LATCHED,
    MOVING,
    NO_FAULT,
    READY,
    RUN,
    SOFT_START,
    STOPPING,
    Fault,
    Mode,
    OperatorRequest,
)


class Conditions(NamedTuple):
    """All inputs of a transition. `fault` is the fault that counts in this mode, or NONE."""

    estop: bool
    fault: Fault
    inputs_fresh: bool
    drive_well: bool
    operator_fresh: bool
    request: OperatorRequest
    idle_seen: bool
    clear_armed: bool
    target_valid: bool
    axis_idle: bool
    freewheel_overspeed: bool
    captured: bool
    standstill: bool


class SupervisorState(NamedTuple):
    """Mode and latched reason. `idle_seen`: IDLE was requested in READY.

    `clear_armed`: since the latch, the operator has sent a request other than CLEAR_FAULTS.
    """

    mode: Mode
    fault: Fault
    disarm_reason: int
    idle_seen: bool
    clear_armed: bool
    ticks_in_mode: int


INITIAL = zeroed(SupervisorState, mode=INIT, fault=NO_FAULT)


def transition(mode: Mode, conditions: Conditions) -> Mode:  # noqa: PLR0911 - a table, read top to bottom
    """The mode after this tick."""
    if conditions.estop:
        return E_STOP
    asks_run = conditions.operator_fresh and conditions.request == ASKS_RUN
    asks_clear = conditions.operator_fresh and conditions.request == ASKS_CLEAR

    if mode in LATCHED:
        if asks_clear and conditions.clear_armed and conditions.fault == NO_FAULT:
            return INIT
        return mode
    if conditions.fault != NO_FAULT:
        return FAULT
    if mode == INIT:
        if conditions.inputs_fresh and conditions.operator_fresh and conditions.drive_well:
            return READY
        return INIT
    if mode == READY:
        if not (conditions.inputs_fresh and conditions.operator_fresh):
            return INIT
        may_start = conditions.axis_idle and conditions.idle_seen and conditions.target_valid
        return SOFT_START if asks_run and may_start and not conditions.freewheel_overspeed else READY
    if mode == STOPPING:
        return READY if conditions.standstill else STOPPING
    if not (asks_run and conditions.target_valid):
        return STOPPING
    if mode == SOFT_START:
        return RUN if conditions.captured else SOFT_START
    return RUN


def counting_fault(mode: Mode, findings: Findings, start_failed: bool) -> Fault:  # noqa: PLR0911 - a table
    """The finding that is a fault in `mode`, or NONE.

    Damaged parameters are a fault from power-up on; only a power-up with valid parameters ends it. A stale
    input is a fault only in motion; before, it keeps the firmware out of READY. Overspeed is a fault only in
    motion, too: the swinging striker may drive a free crank faster. In FAULT and E_STOP the result is the
    reason against clearing; a drive's error is none, because clearing resets it.
    """
    moving = mode in MOVING
    latched = mode in LATCHED
    if findings.parameters_damaged:
        return Fault.PARAMETERS_DAMAGED
    if mode == INIT:
        return NO_FAULT
    if (moving or latched) and findings.watchdog != NO_FAULT:
        return findings.watchdog
    if moving and findings.operator_lost:
        return Fault.OPERATOR_TIMEOUT
    if not latched and findings.drive != NO_FAULT:
        return findings.drive
    if (moving or latched) and findings.overspeed:
        return Fault.OVERSPEED
    if findings.watchdog == NO_FAULT and findings.limit != NO_FAULT:
        return findings.limit
    if start_failed and mode == SOFT_START:
        return Fault.START_FAILED
    if start_failed and mode == RUN:
        return Fault.ATTRACTOR_LOST
    return NO_FAULT


def step(
    state: SupervisorState,
    findings: Findings,
    estop: bool,
    request: OperatorRequest,
    disarm_reason: int,
    target_valid: bool,
    axis_idle: bool,
    captured: bool,
    start_failed: bool,
    elapsed_ticks: int,
) -> SupervisorState:
    """One tick: the new mode, the latched reason, and the requests seen since the mode began.

    `disarm_reason` belongs to an error that is still active, else it is 0.
    """
    mode = state.mode
    operator_fresh = not findings.operator_lost
    fault = counting_fault(mode, findings, start_failed)
    conditions = Conditions(
        estop,
        fault,
        findings.watchdog == NO_FAULT,
        findings.drive == NO_FAULT,
        operator_fresh,
        request,
        state.idle_seen,
        state.clear_armed,
        target_valid,
        axis_idle,
        findings.freewheel_overspeed,
        captured,
        findings.standstill,
    )
    new_mode = transition(mode, conditions)

    latched = new_mode in LATCHED
    reason = state.fault
    reason_of_drive = state.disarm_reason
    if new_mode == FAULT and mode != FAULT:
        reason = fault
        reason_of_drive = 0
    elif not latched:
        reason = NO_FAULT
        reason_of_drive = 0
    if latched and reason == Fault.DRIVE_ERROR and reason_of_drive == 0:
        # The drive reports an error before it reports the reason.
        reason_of_drive = disarm_reason
    stays = new_mode == mode
    idle = operator_fresh and request == ASKS_IDLE
    let_go = operator_fresh and request != ASKS_CLEAR
    return SupervisorState(
        new_mode,
        reason,
        reason_of_drive,
        new_mode == READY and stays and (state.idle_seen or idle),
        latched and stays and (state.clear_armed or let_go),
        state.ticks_in_mode + elapsed_ticks if stays else 0,
    )
