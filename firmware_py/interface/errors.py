"""Errors of frames and records: the reasons of a refusal."""

from enum import IntEnum


class FrameErrorReason(IntEnum):
    """Reason why a frame (decoding) or a record (encoding) is refused."""

    NONE = 0
    LENGTH = 1
    CRC = 2
    RANGE = 3
    ENUMERATION = 4
    NOT_FINITE = 5
    NOT_A_NUMBER = 6
    UNKNOWN_ID = 7
    VALUE = 8
    """One of RANGE, ENUMERATION and NOT_FINITE; the reason itself is determined only for error messages."""


ACCEPTED = FrameErrorReason.NONE


class FrameError(ValueError):
    """A frame that must not be used, or a record that must not be sent."""

    def __init__(self, reason: FrameErrorReason, message: str) -> None:
        super().__init__(message)
        self.reason = reason
