"""What the firmware does in each mode, and in which modes each finding is a fault.

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

MODES_OF_FAULT: dict[Fault, tuple[Mode, ...]] = {
    Fault.NONE: (),
    # Before motion, a stale input keeps the firmware out of READY.
    Fault.SENSOR_TIMEOUT: (*IN_USE, *LATCHED),
    Fault.ENCODER_TIMEOUT: (*IN_USE, *LATCHED),
    Fault.DRIVE_TIMEOUT: (*IN_USE, *LATCHED),
    Fault.STALE_SAMPLES: (*IN_USE, *LATCHED),
    Fault.OPERATOR_TIMEOUT: IN_USE,
    # Clearing resets the drive's error.
    Fault.DRIVE_ERROR: (Mode.READY, *IN_USE),
    # The swinging striker may drive a free crank faster.
    Fault.OVERSPEED: (*IN_USE, *LATCHED),
    **dict.fromkeys((Fault.DRIVE_FROZEN, Fault.OVERCURRENT, Fault.OVERTEMPERATURE), AFTER_INIT),
    **dict.fromkeys((Fault.UNDERVOLTAGE, Fault.OVERVOLTAGE), AFTER_INIT),
    **dict.fromkeys((Fault.IMPULSE_LIMIT, Fault.FORCE_LIMIT, Fault.ESTIMATE_INVALID), AFTER_INIT),
    **dict.fromkeys((Fault.LOAD_IMPLAUSIBLE, Fault.RUNAWAY, Fault.STALL, Fault.STOP_FAILED), AFTER_INIT),
    Fault.START_FAILED: (Mode.SOFT_START,),
    Fault.ATTRACTOR_LOST: (Mode.RUN,),
    Fault.DRIVE_WATCHDOG: (Mode.PROOF,),
    Fault.REQUEST_REFUSED: (),
    # Only a power-up with valid parameters ends it.
    Fault.PARAMETERS_DAMAGED: tuple(Mode),
}
"""The modes in which a finding is a fault, and FAULT and E_STOP where it stands against clearing."""
FAULT_BITS = tuple(sum(1 << mode for mode in MODES_OF_FAULT[fault]) for fault in Fault)
"""For each fault by its number: bit n is set for the mode n."""
