"""The enums of the bus: those of `vibro.dbc`, which `generate.py` writes, and those that no frame lists."""

from enum import IntEnum

from firmware_py.interface.generated.enums import *  # noqa: F403 - the list is that of the DBC
from firmware_py.interface.generated.enums import AxisState, OperatorRequest


class ContactPhase(IntEnum):
    """Whether the firmware estimates that the striker touches the stop."""

    FREE = 0
    CONTACT = 1


class XcpCommandCode(IntEnum):
    """XCP: the commands that the firmware's slave has."""

    ALLOC_ODT_ENTRY = 0xD3
    ALLOC_ODT = 0xD4
    ALLOC_DAQ = 0xD5
    FREE_DAQ = 0xD6
    GET_DAQ_EVENT_INFO = 0xD7
    GET_DAQ_LIST_INFO = 0xD8
    GET_DAQ_RESOLUTION_INFO = 0xD9
    GET_DAQ_PROCESSOR_INFO = 0xDA
    GET_DAQ_CLOCK = 0xDC
    START_STOP_SYNCH = 0xDD
    START_STOP_DAQ_LIST = 0xDE
    GET_DAQ_LIST_MODE = 0xDF
    SET_DAQ_LIST_MODE = 0xE0
    WRITE_DAQ = 0xE1
    SET_DAQ_PTR = 0xE2
    DOWNLOAD = 0xF0
    BUILD_CHECKSUM = 0xF3
    SHORT_UPLOAD = 0xF4
    UPLOAD = 0xF5
    SET_MTA = 0xF6
    GET_ID = 0xFA
    GET_COMM_MODE_INFO = 0xFB
    SYNCH = 0xFC
    GET_STATUS = 0xFD
    DISCONNECT = 0xFE
    CONNECT = 0xFF


class XcpError(IntEnum):
    """XCP: the errors of the firmware's slave; NONE stands for a positive response."""

    CMD_SYNCH = 0x00
    DAQ_ACTIVE = 0x11
    CMD_UNKNOWN = 0x20
    OUT_OF_RANGE = 0x22
    WRITE_PROTECTED = 0x23
    ACCESS_DENIED = 0x24
    MODE_NOT_VALID = 0x27
    SEQUENCE = 0x29
    DAQ_CONFIG = 0x2A
    MEMORY_OVERFLOW = 0x30
    NONE = 0xFF


class ParameterTier(IntEnum):
    """Origin of a parameter's value: the build, the module, or tuning.

    Parameters of the build cannot be written over the bus or by a file.
    """

    BUILD = 0
    MODULE = 1
    TUNING = 2


def axis_state_of(value: int) -> AxisState:
    """The axis state of a decoded frame; a compiled build reinterprets the number."""
    return AxisState(value)


def operator_request_of(value: int) -> OperatorRequest:
    """The request of a decoded frame; a compiled build reinterprets the number."""
    return OperatorRequest(value)
