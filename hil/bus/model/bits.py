"""A classic data frame with an 11-bit identifier, bit by bit as it stands on the wire.

The frame from its start bit to the end of its checksum is stuffed: after five equal bits the transmitter
inserts one of the other value, and an inserted bit counts towards the next five. Checksum delimiter,
acknowledgement, end of frame and intermission follow unstuffed (Bosch, "CAN Specification 2.0", 1991,
part A, sections 3.1 and 5; ISO 11898-1). 0 is the dominant level, 1 the recessive one.

The usual bound on a frame's length, 55 + 10·n bits for n data bytes, is never reached: RTR, IDE, r0 and the
length code are fixed, and the checksum depends on the other bits.
"""

import re
from functools import cache

from firmware_py.interface.frame import Frame
from hil.timing.clock import NS_PER_S
from text_input import RefusalError

CRC_POLYNOMIAL = 0x4599
"""x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1 without its leading term."""
CRC_BITS = 15
CRC_MASK = 0x7FFF

STUFF_RUN = 5
"""Number of equal bits after which a bit of the opposite value is inserted."""
STUFFED_RUNS = re.compile("00000(?:11110000)*(?:1111)?|11111(?:00001111)*(?:0000)?")
"""A run of five equal bits, and the runs of four that follow directly: an inserted bit makes five of each."""

DELIMITERS_AND_ACK_BITS = 3
"""Checksum delimiter, acknowledgement slot, acknowledgement delimiter."""
END_OF_FRAME_BITS = 7
INTERMISSION_BITS = 3
TAIL_BITS = DELIMITERS_AND_ACK_BITS + END_OF_FRAME_BITS
"""Bits of the frame after its stuffed part."""

RECESSIVE_TAIL_BITS = 1 + END_OF_FRAME_BITS + INTERMISSION_BITS
"""Acknowledgement delimiter to intermission: the run of recessive bits after every frame. An error
delimiter and its intermission have the same length."""
ERROR_FRAME_BITS = 2 * 6 + 8
"""The longest error frame: an error flag, the flags that answer it, and the delimiter of recessive bits."""
SUSPEND_BITS = 8
"""Bits for which an error-passive node suspends transmission after a frame of its own."""


class BitRateError(RefusalError, ValueError):
    """A bit rate outside CAN's range, or with a bit time that is not a whole number of nanoseconds."""


def bit_ns_of(bitrate: int) -> int:
    """Return the duration of a bit; it has to be a whole number of nanoseconds.

    >>> bit_ns_of(500_000)
    2000
    """
    if not 10_000 <= bitrate <= 1_000_000 or NS_PER_S % bitrate:
        raise BitRateError(
            f"bit rate {bitrate}; wanted 10000 to 1000000 bit/s with bits of whole nanoseconds, such as "
            "1000000, 500000, 250000 or 125000"
        )
    return NS_PER_S // bitrate


def crc15(bits: str) -> int:
    """Return the checksum over unstuffed `bits`.

    >>> hex(crc15("".join(f"{byte:08b}" for byte in b"123456789")))
    '0x59e'
    """
    # Zeros before a frame leave the register at 0, so that all bits come in whole bytes.
    register = 0
    for byte in int(f"0{bits}", 2).to_bytes(-(-len(bits) // 8)):
        register = (register << 8 & CRC_MASK) ^ crc_table()[register >> 7 ^ byte]
    return register


@cache
def crc_table() -> tuple[int, ...]:
    """The register's change by a byte, by its upper 8 bits xor the byte."""
    table = []
    for byte in range(256):
        register = byte << 7
        for _ in range(8):
            register = register << 1 ^ (CRC_POLYNOMIAL if register >> 14 & 1 else 0)
        table.append(register & CRC_MASK)
    return tuple(table)


def stuff_bits(bits: str) -> int:
    """Return the number of stuff bits in `bits`, including the one after a final run of five.

    >>> stuff_bits("111110000"), stuff_bits("111110001")
    (2, 1)
    """
    runs = STUFFED_RUNS.findall(bits)  # of 5 bits for one stuff bit, 9 for two, 13 for three …
    return (len("".join(runs)) - len(runs)) // (STUFF_RUN - 1)


def unstuffed_bits(frame: Frame) -> str:
    """Return start bit, identifier, RTR, IDE, r0, length code, data and checksum, before stuffing."""
    can_id, data = frame
    if not 0 <= can_id <= 0x7FF or len(data) > 8:
        raise ValueError(
            f"frame 0x{can_id:X} with {len(data)} data bytes is no classic CAN frame; "
            "wanted an identifier in 0…0x7FF and at most 8 bytes"
        )
    content = f"{int.from_bytes(data):0{8 * len(data)}b}" if data else ""
    body = f"0{can_id:011b}000{len(data):04b}{content}"
    return f"{body}{crc15(body):0{CRC_BITS}b}"


def frame_bits(frame: Frame) -> int:
    """Return the bits that `frame` takes on the wire, start bit to intermission, stuff bits included.

    >>> frame_bits(Frame(0x123, bytes.fromhex("dead")))
    64
    """
    bits = unstuffed_bits(frame)
    return len(bits) + stuff_bits(bits) + TAIL_BITS + INTERMISSION_BITS
