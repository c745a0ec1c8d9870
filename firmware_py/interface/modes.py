"""What the firmware does in each mode, and on each fault: a row each.

`core.safety.supervisor` decides the mode; the other blocks read its row.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.interface.enums import Fault, Mode


class AxisRequest(IntEnum):
    """The state requested of the axis. KEEP: no frame, the axis stays as it is.

    OPEN at rest and DISARM on a fault both send IDLE; each needs its own confirmation.
    """

    OPEN = 0
    DISARM = 1
    STOP = 2
    CLOSE = 3
    KEEP = 4


class Target(IntEnum):
    """The source of the crank's target speed: none, the start and the hold after it, or the stop."""

    NONE = 0
    START = 1
    STOP = 2


OPEN, DISARM, STOP, CLOSE, KEEP = AxisRequest


class ModeRow(NamedTuple):
    """A mode. `moving`: the crank is driven. `latched`: only a CLEAR_FAULTS of the operator ends the mode.

    `ends_consent`: no earlier request of the operator counts any more. `calibrates`: no torque can act, so
    parameters may be written that may be written at rest.
    """

    moving: bool
    latched: bool
    axis: AxisRequest
    target: Target
    ends_consent: bool
    calibrates: bool


class FaultRow(NamedTuple):
    """A finding. `modes`: bit n is set if it is a fault in mode n, or in FAULT and E_STOP against clearing.

    `axis`: the state requested of the axis while the fault is latched.
    """

    modes: int
    axis: AxisRequest


ROW_OF_MODE = {
    #                        moving latched axis    target      ends_consent calibrates
    Mode.INIT: ModeRow(False, False, OPEN, Target.NONE, False, True),
    Mode.READY: ModeRow(False, False, OPEN, Target.NONE, True, True),
    Mode.SOFT_START: ModeRow(True, False, CLOSE, Target.START, False, False),
    Mode.RUN: ModeRow(True, False, KEEP, Target.START, False, False),
    Mode.STOPPING: ModeRow(True, False, KEEP, Target.STOP, False, False),
    Mode.FAULT: ModeRow(False, True, DISARM, Target.NONE, True, True),
    Mode.E_STOP: ModeRow(False, True, STOP, Target.NONE, True, True),
    Mode.PROOF: ModeRow(False, False, OPEN, Target.NONE, False, False),
}

MODES = tuple(ROW_OF_MODE[mode] for mode in Mode)
"""The row of each mode by its number."""
MOVING = tuple(mode for mode in Mode if MODES[mode].moving)
LATCHED = tuple(mode for mode in Mode if MODES[mode].latched)
IN_USE = (*MOVING, Mode.PROOF)
"""Modes in which the drive's axis may be closed."""
AFTER_INIT = tuple(mode for mode in Mode if mode != Mode.INIT)


def fault_row(*modes: Mode, axis: AxisRequest = DISARM) -> FaultRow:
    """The row of a finding that is a fault in these modes."""
    return FaultRow(sum(1 << mode for mode in modes), axis)


ROW_OF_FAULT = {
    Fault.NONE: fault_row(),
    # Before motion, a stale input keeps the firmware out of READY.
    Fault.SENSOR_TIMEOUT: fault_row(*IN_USE, *LATCHED),
    Fault.ENCODER_TIMEOUT: fault_row(*IN_USE, *LATCHED),
    Fault.DRIVE_TIMEOUT: fault_row(*IN_USE, *LATCHED),
    Fault.STALE_SAMPLES: fault_row(*IN_USE, *LATCHED),
    Fault.OPERATOR_TIMEOUT: fault_row(*IN_USE),
    # Clearing resets the drive's error.
    Fault.DRIVE_ERROR: fault_row(Mode.READY, *IN_USE),
    # The swinging striker may drive a free crank faster.
    Fault.OVERSPEED: fault_row(*IN_USE, *LATCHED),
    Fault.DRIVE_FROZEN: fault_row(*AFTER_INIT),
    Fault.OVERCURRENT: fault_row(*AFTER_INIT),
    Fault.OVERTEMPERATURE: fault_row(*AFTER_INIT),
    Fault.UNDERVOLTAGE: fault_row(*AFTER_INIT),
    Fault.OVERVOLTAGE: fault_row(*AFTER_INIT),
    Fault.IMPULSE_LIMIT: fault_row(*AFTER_INIT),
    Fault.FORCE_LIMIT: fault_row(*AFTER_INIT),
    Fault.ESTIMATE_INVALID: fault_row(*AFTER_INIT),
    Fault.LOAD_IMPLAUSIBLE: fault_row(*AFTER_INIT),
    Fault.RUNAWAY: fault_row(*AFTER_INIT),
    Fault.STALL: fault_row(*AFTER_INIT),
    Fault.STOP_FAILED: fault_row(*AFTER_INIT),
    Fault.START_FAILED: fault_row(Mode.SOFT_START),
    Fault.ATTRACTOR_LOST: fault_row(Mode.RUN),
    Fault.DRIVE_WATCHDOG: fault_row(Mode.PROOF),
    Fault.REQUEST_REFUSED: fault_row(),
    # Only a power-up with valid parameters ends it.
    Fault.PARAMETERS_DAMAGED: fault_row(*Mode),
}
FAULTS = tuple(ROW_OF_FAULT[fault] for fault in Fault)
"""The row of each fault by its number."""
