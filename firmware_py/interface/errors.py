"""Why a frame or a record is refused."""

from enum import Enum, auto


class FrameErrorReason(Enum):
    """What is wrong with a frame (decoding) or with a record (encoding)."""

    UNKNOWN_ID = auto()
    LENGTH = auto()
    CRC = auto()
    RANGE = auto()
    ENUMERATION = auto()
    NOT_FINITE = auto()
    NOT_A_NUMBER = auto()


class FrameError(ValueError):
    """A frame that must not be used, or a record that must not be sent."""

    def __init__(self, reason: FrameErrorReason, message: str) -> None:
        super().__init__(message)
        self.reason = reason
