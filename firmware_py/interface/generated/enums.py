"""The value tables of `vibro.dbc`: written by `generate.py`; do not edit."""

from enum import IntEnum


class Mode(IntEnum):
    """Mode of the supervisor."""

    INIT = 0
    READY = 1
    SOFT_START = 2
    RUN = 3
    STOPPING = 4
    FAULT = 5
    E_STOP = 6
    PROOF = 7


class OperatorRequest(IntEnum):
    """The operator's request. RUN and PROVE_WATCHDOG act only in READY, and only after a request for
    IDLE.
    """

    IDLE = 0
    RUN = 1
    CLEAR_FAULTS = 2
    PROVE_WATCHDOG = 3


class Regime(IntEnum):
    """Regime of the striker's motion, decided per drive period."""

    UNCERTAIN = 0
    NON_IMPACT = 1
    IMPACT = 2
    PERIOD_N = 3
    LOST = 4
    CHATTERING = 5
    STUCK = 6


class GaitState(IntEnum):
    """State of the wearer's leg. STANDING: the leg is at rest; UNCERTAIN: the gait phase is
    unreliable.
    """

    STANDING = 0
    STANCE = 1
    SWING = 2
    UNCERTAIN = 3


class Fault(IntEnum):
    """Reason of disarming, latched until the operator clears it; REQUEST_REFUSED does not disarm."""

    NONE = 0
    SENSOR_TIMEOUT = 1
    ENCODER_TIMEOUT = 2
    DRIVE_TIMEOUT = 3
    OPERATOR_TIMEOUT = 4
    DRIVE_ERROR = 5
    DRIVE_FROZEN = 6
    OVERSPEED = 7
    OVERCURRENT = 8
    OVERTEMPERATURE = 9
    UNDERVOLTAGE = 10
    OVERVOLTAGE = 11
    IMPULSE_LIMIT = 12
    ESTIMATE_INVALID = 13
    START_FAILED = 14
    ATTRACTOR_LOST = 15
    STALL = 16
    FORCE_LIMIT = 17
    REQUEST_REFUSED = 18
    PARAMETERS_DAMAGED = 19
    RUNAWAY = 20
    LOAD_IMPLAUSIBLE = 21
    STOP_FAILED = 22
    STALE_SAMPLES = 23
    DRIVE_WATCHDOG = 24


class Refusal(IntEnum):
    """Reason why a request is not met; the firmware uses the nearest possible setting, or waits."""

    NONE = 0
    RATIO_OUT_OF_RANGE = 1
    IMPULSE_OUT_OF_RANGE = 2
    IMPULSE_TOO_HIGH = 3
    IMPULSE_TOO_LOW = 4
    NOT_WALKING = 5
    NO_HARMONIC = 6
    RATIO_TOO_HIGH = 7
    CRANK_TOO_FAST = 8
    WATCHDOG_UNPROVEN = 9
    OUT_OF_SEQUENCE = 10


class ActingLimit(IntEnum):
    """The limit that acts on the torque at present. IMPACT_PHASE keeps the speed away from the fold,
    RETREAT from the speed at which the impacts were lost.
    """

    NONE = 0
    TORQUE = 1
    TORQUE_RATE = 2
    SPEED = 3
    SAFE_STATE = 4
    IMPACT_PHASE = 5
    RETREAT = 6


class AxisState(IntEnum):
    """ODrive 0.6 axis states; the bench itself uses IDLE and CLOSED_LOOP_CONTROL."""

    UNDEFINED = 0
    IDLE = 1
    STARTUP_SEQUENCE = 2
    FULL_CALIBRATION_SEQUENCE = 3
    MOTOR_CALIBRATION = 4
    SENSORLESS_CONTROL = 5
    ENCODER_INDEX_SEARCH = 6
    ENCODER_OFFSET_CALIBRATION = 7
    CLOSED_LOOP_CONTROL = 8
    LOCKIN_SPIN = 9
    ENCODER_DIR_FIND = 10
    HOMING = 11
    ENCODER_HALL_POLARITY_CALIBRATION = 12
    ENCODER_HALL_PHASE_CALIBRATION = 13
    ANTICOGGING_CALIBRATION = 14


class AxisError(IntEnum):
    """ODrive 0.6 error bits; an error field is any combination of them."""

    NONE = 0
    INITIALIZING = 0x00000001
    SYSTEM_LEVEL = 0x00000002
    TIMING_ERROR = 0x00000004
    MISSING_ESTIMATE = 0x00000008
    BAD_CONFIG = 0x00000010
    DRV_FAULT = 0x00000020
    MISSING_INPUT = 0x00000040
    DC_BUS_OVER_VOLTAGE = 0x00000100
    DC_BUS_UNDER_VOLTAGE = 0x00000200
    DC_BUS_OVER_CURRENT = 0x00000400
    DC_BUS_OVER_REGEN_CURRENT = 0x00000800
    CURRENT_LIMIT_VIOLATION = 0x00001000
    MOTOR_OVER_TEMP = 0x00002000
    INVERTER_OVER_TEMP = 0x00004000
    VELOCITY_LIMIT_VIOLATION = 0x00008000
    POSITION_LIMIT_VIOLATION = 0x00010000
    WATCHDOG_TIMER_EXPIRED = 0x01000000
    ESTOP_REQUESTED = 0x02000000
    SPINOUT_DETECTED = 0x04000000
    BRAKE_RESISTOR_DISARMED = 0x08000000
    THERMISTOR_DISCONNECTED = 0x10000000
    CALIBRATION_ERROR = 0x40000000


class ProcedureResult(IntEnum):
    """ODrive 0.6: result of the axis's last procedure."""

    SUCCESS = 0
    BUSY = 1
    CANCELLED = 2
    DISARMED = 3
    NO_RESPONSE = 4
    POLE_PAIR_CPR_MISMATCH = 5
    PHASE_RESISTANCE_OUT_OF_RANGE = 6
    PHASE_INDUCTANCE_OUT_OF_RANGE = 7
    UNBALANCED_PHASES = 8
    INVALID_MOTOR_TYPE = 9
    ILLEGAL_HALL_STATE = 10
    TIMEOUT = 11
    HOMING_WITHOUT_ENDSTOP = 12
    INVALID_STATE = 13
    NOT_CALIBRATED = 14
    NOT_CONVERGING = 15


class ControlMode(IntEnum):
    """ODrive 0.6: quantity that the drive's controller regulates. The bench uses TORQUE_CONTROL."""

    VOLTAGE_CONTROL = 0
    TORQUE_CONTROL = 1
    VELOCITY_CONTROL = 2
    POSITION_CONTROL = 3


class InputMode(IntEnum):
    """ODrive 0.6: treatment of the controller's set-points. The bench uses PASSTHROUGH."""

    INACTIVE = 0
    PASSTHROUGH = 1
    VEL_RAMP = 2
    POS_FILTER = 3
    MIX_CHANNELS = 4
    TRAP_TRAJ = 5
    TORQUE_RAMP = 6
    MIRROR = 7
    TUNING = 8
