"""A classic CAN data frame, as bytes or as one 64-bit word, and the reasons for which one is refused."""

import struct
from enum import IntEnum
from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame: `can_id` in 0…0x7FF, `data` of 0…8 bytes."""

    can_id: int
    data: bytes


class WordFrame(NamedTuple):
    """One classic CAN frame as the firmware's tick handles it; three 64-bit integers in memory.

    `word` is signed. Byte 0 is in its lowest bits; bytes beyond `length` are 0.
    """

    can_id: int
    length: int
    word: int


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


_WORD = struct.Struct("<q")


def word_of(data: bytes) -> int:
    """At most eight bytes as one signed 64-bit word.

    >>> word_of(bytes([1, 2]))
    513
    """
    word: int = _WORD.unpack(data)[0] if len(data) == 8 else int.from_bytes(data, "little")
    return word


def bytes_of(word: int, length: int) -> bytes:
    """The first `length` bytes of a signed 64-bit word.

    >>> bytes_of(513, 2)
    b'\\x01\\x02'
    """
    return _WORD.pack(word)[:length]


def worst_case_bits(length: int) -> int:
    """Return the largest number of bits of a frame with an 11-bit identifier and `length` data bytes.

    34 + 8·length bits are subject to stuffing, with one stuff bit per four bits in the worst case; 13 bits
    are not: the end of the frame and the interframe space (Davis et al., "Controller Area Network (CAN)
    schedulability analysis: Refuted, revisited and revised", 2007, eq. 1).

    >>> worst_case_bits(8)
    135
    """
    return 55 + 10 * length
