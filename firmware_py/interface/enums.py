"""The states that travel on CAN. Values are part of the bus contract; `vibro.dbc` names the same ones."""

from enum import IntEnum


class Mode(IntEnum):
    """What the supervisor is doing."""

    INIT = 0
    READY = 1
    SOFT_START = 2
    RUN = 3
    STOPPING = 4
    FAULT = 5
    E_STOP = 6


class OperatorRequest(IntEnum):
    """What the operator asks for. RUN starts only out of READY, and only after IDLE has been seen."""

    IDLE = 0
    RUN = 1
    CLEAR_FAULTS = 2


class Regime(IntEnum):
    """What the striker is doing, per drive period."""

    UNCERTAIN = 0
    NON_IMPACT = 1
    IMPACT = 2
    PERIOD_N = 3
    LOST = 4
    CHATTERING = 5
    STUCK = 6


class ContactPhase(IntEnum):
    """Where the firmware believes the striker to be."""

    FREE = 0
    CONTACT = 1


class Fault(IntEnum):
    """Why the firmware disarmed; latched until the operator clears it."""

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


class ActingLimit(IntEnum):
    """Which limit is shaping the torque right now."""

    NONE = 0
    TORQUE = 1
    TORQUE_RATE = 2
    SPEED = 3
    SAFE_STATE = 4


class AxisState(IntEnum):
    """ODrive 0.6 axis states that the bench uses."""

    UNDEFINED = 0
    IDLE = 1
    CLOSED_LOOP_CONTROL = 8


class AxisError(IntEnum):
    """ODrive 0.6 error bits that the bench uses."""

    NONE = 0
    DC_BUS_OVER_VOLTAGE = 0x00000100
    DC_BUS_UNDER_VOLTAGE = 0x00000200
    DC_BUS_OVER_CURRENT = 0x00000400
    MOTOR_OVER_TEMP = 0x00002000
    INVERTER_OVER_TEMP = 0x00004000
    VELOCITY_LIMIT_VIOLATION = 0x00008000
    WATCHDOG_TIMER_EXPIRED = 0x01000000
    ESTOP_REQUESTED = 0x02000000


class ParameterOperation(IntEnum):
    """What a parameter request asks for."""

    READ = 0
    WRITE = 1


class ParameterStatus(IntEnum):
    """How a parameter request ended."""

    OK = 0
    UNKNOWN_INDEX = 1
    OUT_OF_RANGE = 2
    NOT_WHILE_MOVING = 3
