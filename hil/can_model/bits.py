"""A classic data frame with an 11-bit identifier, bit by bit as it stands on the wire.

The frame from its start bit to the end of its checksum is stuffed: after five equal bits the transmitter
inserts one of the other value, and an inserted bit counts towards the next five. Checksum delimiter,
acknowledgement, end of frame and intermission follow unstuffed (Bosch, "CAN Specification 2.0", 1991,
part A, sections 3.1 and 5; ISO 11898-1). 0 is the dominant level, 1 the recessive one.

The usual bound on a frame's length, 55 + 10·n bits for n data bytes, is never reached: RTR, IDE, r0 and the
length code are fixed, and the checksum depends on the other bits. A complete search over all identifiers
and data gives 53, 62, 72, 83, 93, 102, 113, 124 and 133 bits for n = 0 … 8.
"""

from functools import cache
from typing import NamedTuple

from firmware_py.interface.frame import Frame

CRC_POLYNOMIAL = 0x4599
"""x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1 without its leading term."""
CRC_BITS = 15
CRC_MASK = 0x7FFF

STUFF_RUN = 5
"""Number of equal bits after which a bit of the opposite value is inserted."""

DELIMITERS_AND_ACK_BITS = 3
"""Checksum delimiter, acknowledgement slot, acknowledgement delimiter."""
END_OF_FRAME_BITS = 7
INTERMISSION_BITS = 3
TAIL_BITS = DELIMITERS_AND_ACK_BITS + END_OF_FRAME_BITS
"""Bits of the frame after its stuffed part."""

BITS_BEFORE_DATA = 19
"""Start bit to length code."""
RECESSIVE_TAIL_BITS = 1 + END_OF_FRAME_BITS + INTERMISSION_BITS
"""Acknowledgement delimiter to intermission: the run of recessive bits after every frame. An error
delimiter and its intermission have the same length."""
ERROR_FRAME_BITS = 2 * 6 + 8
"""The longest error frame: an error flag, the flags that answer it, and the delimiter of recessive bits."""
SUSPEND_BITS = 8
"""Bits for which an error-passive node suspends transmission after a frame of its own."""

_IDLE = 1
"""State of the stuffing rule on an idle bus: run 0 of recessive bits."""

NS_PER_S = 1_000_000_000


class BitRateError(ValueError):
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


def crc15(bits: tuple[int, ...], register: int = 0) -> int:
    """Return the checksum over unstuffed `bits`; `register` continues from preceding bits.

    >>> check = tuple(byte >> shift & 1 for byte in b"123456789" for shift in range(7, -1, -1))
    >>> hex(crc15(check))
    '0x59e'
    """
    for bit in bits:
        carry = bit ^ register >> (CRC_BITS - 1)
        register = (register << 1) & CRC_MASK
        if carry:
            register ^= CRC_POLYNOMIAL
    return register


def stuffed(bits: tuple[int, ...]) -> tuple[int, ...]:
    """Return `bits` with the stuff bits inserted, including the one after a final run of five.

    >>> stuffed((1, 1, 1, 1, 1, 0, 0, 0, 0))
    (1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 1)
    """
    return _stuffed_from(_IDLE, bits)[0]


def _stuffed_from(state: int, bits: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
    """Return `bits` with the stuff bits inserted, and the stuffing rule's new state.

    The state is 2 · run + bit: the last wire bit and the number of equal bits in a row up to it.
    """
    wire: list[int] = []
    run, run_bit = state >> 1, state & 1
    for bit in bits:
        wire.append(bit)
        run = run + 1 if bit == run_bit else 1
        run_bit = bit
        if run == STUFF_RUN:
            run_bit, run = 1 - bit, 1
            wire.append(run_bit)
    return tuple(wire), run << 1 | run_bit


def _bits(value: int, count: int) -> tuple[int, ...]:
    """Return the `count` low bits of `value`, the most significant first."""
    return tuple(value >> shift & 1 for shift in range(count - 1, -1, -1))


def _checked(frame: Frame) -> Frame:
    if not 0 <= frame.can_id <= 0x7FF or len(frame.data) > 8:
        raise ValueError(
            f"frame 0x{frame.can_id:X} with {len(frame.data)} data bytes is no classic CAN frame; "
            "wanted an identifier in 0…0x7FF and at most 8 bytes"
        )
    return frame


def unstuffed_bits(frame: Frame) -> tuple[int, ...]:
    """Return start bit, identifier, RTR, IDE, r0, length code, data and checksum, before stuffing."""
    can_id, data = _checked(frame)
    body = (0, *_bits(can_id, 11), 0, 0, 0, *_bits(len(data), 4))
    for byte in data:
        body += _bits(byte, 8)
    return body + _bits(crc15(body), CRC_BITS)


# The functions below compute lengths from tables, for models that send millions of frames.

_STATES = 2 * STUFF_RUN
_STATE_BITS = 4
_STATE_MASK = (1 << _STATE_BITS) - 1


class _Tables(NamedTuple):
    """Tables by state and next bits. A stuffing entry: the new state, and above its 4 bits the stuff bits."""

    crc: tuple[int, ...]  # checksum register's change, by its upper 8 bits xor the next byte
    byte: tuple[int, ...]  # by state << 8 | byte
    seven: tuple[int, ...]  # by state << 7 | bits; a checksum is 8 + 7 bits


def _stuffing_step(state: int, bits: tuple[int, ...]) -> int:
    wire, after = _stuffed_from(state, bits)
    return len(wire) - len(bits) << _STATE_BITS | after


@cache
def _tables() -> _Tables:
    return _Tables(
        crc=tuple(crc15(_bits(byte, 8)) for byte in range(256)),
        byte=tuple(_stuffing_step(s, _bits(byte, 8)) for s in range(_STATES) for byte in range(256)),
        seven=tuple(_stuffing_step(s, _bits(part, 7)) for s in range(_STATES) for part in range(128)),
    )


@cache
def _header(can_id: int, length: int) -> tuple[int, int, int]:
    """Checksum register, stuffing state and stuff bits after start bit … length code; at most 2048 · 9."""
    bits = unstuffed_bits(Frame(can_id, bytes(length)))[:BITS_BEFORE_DATA]
    step = _stuffing_step(_IDLE, bits)
    return crc15(bits), step & _STATE_MASK, step >> _STATE_BITS


def frame_bits(frame: Frame) -> int:
    """Return the bits that `frame` takes on the wire, start bit to intermission, stuff bits included.

    >>> frame_bits(Frame(0x123, bytes.fromhex("dead")))
    64
    """
    can_id, data = _checked(frame)
    tables = _tables()
    register, state, inserted = _header(can_id, len(data))
    for byte in data:
        register = tables.crc[register >> 7 ^ byte] ^ (register << 8 & CRC_MASK)
        step = tables.byte[state << 8 | byte]
        state = step & _STATE_MASK
        inserted += step >> _STATE_BITS
    step = tables.byte[state << 8 | register >> 7]
    inserted += step >> _STATE_BITS
    step = tables.seven[(step & _STATE_MASK) << 7 | register & 0x7F]
    inserted += step >> _STATE_BITS
    return 34 + 8 * len(data) + inserted + TAIL_BITS + INTERMISSION_BITS
