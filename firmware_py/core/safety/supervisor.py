"""The firmware's mode and its reason: one pure transition function.

Nothing moves at power-up. INIT waits until every input is fresh and the drive has no error. READY waits until
the drive has confirmed that its axis is idle, and the crank is slow enough to be taken over; only then does a
RUN request start the motor, to which the operator has changed from IDLE in READY (see `consent`). The test of
the drive's watchdog (PROOF) begins likewise, by a request of its own and with the crank at rest; where it is
required, no start comes before it. A fault is latched with its first reason, and so is an E-stop. Both are
cleared only by a CLEAR_FAULTS to which the operator changes afterwards, once the cause has gone, and lead to
INIT, so that all conditions of a start are checked again. Clearing never arms.
"""

from typing import NamedTuple

from firmware_py.core.safety.gate import Findings
from firmware_py.interface.enums import Fault, Mode, OperatorRequest
from firmware_py.interface.modes import FAULT_BITS, MODES
from firmware_py.interface.zeroed import zeroed


class Observed(NamedTuple):
    """What the supervisor observes in a tick beside the findings.

    `request`: the one that counts, see `consent`. `too_fast`: for a start to take the crank over.
    `disarm_reason` belongs to an error of the drive that is
    still active, else it is 0. `proof_…`: result of the test of the drive's watchdog; `proven`: it has passed
    or is not required.
    """

    parameters_damaged: bool
    standstill: bool
    too_fast: bool
    estop: bool
    request: OperatorRequest
    disarm_reason: int
    target_valid: bool
    axis_idle: bool
    captured: bool
    start_failed: bool
    proof_passed: bool
    proof_failed: bool
    proven: bool


class SupervisorState(NamedTuple):
    """Mode and latched reason."""

    mode: Mode
    fault: Fault
    disarm_reason: int


INITIAL = zeroed(SupervisorState, mode=Mode.INIT, fault=Fault.NONE)


def transition(  # noqa: PLR0911 - a table
    state: SupervisorState, fault: Fault, findings: Findings, now: Observed
) -> Mode:
    """The mode after this tick. `fault`: the finding that is a fault in the present mode, or NONE."""
    mode = state.mode
    all_fresh = not findings.operator_lost and findings.watchdog == Fault.NONE
    asks_run = now.request == OperatorRequest.RUN
    asks_clear = now.request == OperatorRequest.CLEAR_FAULTS
    asks_proof = now.request == OperatorRequest.PROVE_WATCHDOG
    if now.estop:
        return Mode.E_STOP
    if MODES[mode.value].latched:
        return Mode.INIT if asks_clear and fault == Fault.NONE else mode
    if fault != Fault.NONE:
        return Mode.FAULT
    if mode == Mode.INIT:
        return Mode.READY if all_fresh and findings.drive == Fault.NONE else Mode.INIT
    if mode == Mode.READY:
        if not all_fresh:
            return Mode.INIT
        may_close = now.axis_idle and not now.too_fast
        if asks_run and may_close and now.target_valid and now.proven:
            return Mode.SOFT_START
        return Mode.PROOF if asks_proof and may_close and now.standstill else Mode.READY
    if mode == Mode.PROOF:
        unfinished = Mode.PROOF if asks_proof else Mode.INIT
        return Mode.READY if now.proof_passed else unfinished
    if mode == Mode.STOPPING:
        return Mode.READY if now.standstill else Mode.STOPPING
    if not (asks_run and now.target_valid):
        return Mode.STOPPING
    return Mode.SOFT_START if mode == Mode.SOFT_START and not now.captured else Mode.RUN


def counts(fault: Fault, mode: Mode) -> bool:
    """Whether a finding is a fault in `mode`."""
    return FAULT_BITS[fault.value] >> mode.value & 1 == 1


def find_fault(  # noqa: PLR0911 - a list in the order of priority
    mode: Mode, findings: Findings, now: Observed
) -> Fault:
    """The first finding that is a fault in `mode`, or NONE; in FAULT and E_STOP the reason against clearing.

    A limit counts only where no input is stale.
    """
    if now.parameters_damaged and counts(Fault.PARAMETERS_DAMAGED, mode):
        return Fault.PARAMETERS_DAMAGED
    if counts(findings.watchdog, mode):
        return findings.watchdog
    if findings.operator_lost and counts(Fault.OPERATOR_TIMEOUT, mode):
        return Fault.OPERATOR_TIMEOUT
    if counts(findings.drive, mode):
        return findings.drive
    if findings.overspeed and counts(Fault.OVERSPEED, mode):
        return Fault.OVERSPEED
    if findings.watchdog == Fault.NONE and counts(findings.limit, mode):
        return findings.limit
    if now.proof_failed and counts(Fault.DRIVE_WATCHDOG, mode):
        return Fault.DRIVE_WATCHDOG
    if now.start_failed and counts(Fault.START_FAILED, mode):
        return Fault.START_FAILED
    if now.start_failed and counts(Fault.ATTRACTOR_LOST, mode):
        return Fault.ATTRACTOR_LOST
    return Fault.NONE


def latch_reason(
    state: SupervisorState, new_mode: Mode, fault: Fault, disarm_reason: int
) -> tuple[Fault, int]:
    """The latched fault and the drive's reason after this tick; NONE and 0 in other modes."""
    if not MODES[new_mode.value].latched:
        return Fault.NONE, 0
    reason, reason_of_drive = state.fault, state.disarm_reason
    if new_mode == Mode.FAULT and state.mode != Mode.FAULT:
        reason, reason_of_drive = fault, 0
    if reason == Fault.DRIVE_ERROR and reason_of_drive == 0:
        # The drive reports an error before it reports the reason.
        reason_of_drive = disarm_reason
    return reason, reason_of_drive


def step(state: SupervisorState, findings: Findings, now: Observed) -> SupervisorState:
    """One tick: the new mode and the latched reason."""
    fault = find_fault(state.mode, findings, now)
    new_mode = transition(state, fault, findings, now)
    reason, reason_of_drive = latch_reason(state, new_mode, fault, now.disarm_reason)
    return SupervisorState(mode=new_mode, fault=reason, disarm_reason=reason_of_drive)
