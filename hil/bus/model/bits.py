"""A classic data frame with an 11-bit identifier, bit by bit as it stands on the wire.

The frame from its start bit to the end of its checksum is stuffed: after five equal bits the transmitter
inserts one of the other value, and an inserted bit counts towards the next five. Checksum delimiter,
acknowledgement, end of frame and intermission follow unstuffed (Bosch, "CAN Specification 2.0", 1991,
part A, sections 3.1 and 5; ISO 11898-1). 0 is the dominant level, 1 the recessive one.

The usual bound on a frame's length, 55 + 10·n bits for n data bytes, is never reached: RTR, IDE, r0 and the
length code are fixed, and the checksum depends on the other bits.
"""

from typing import NamedTuple

from firmware_py.interface.frame import Frame, word_of
from hil.timing.clock import NS_PER_S
from plant_sim.kernels import jit, subroutine
from text_input import RefusalError

CRC_POLYNOMIAL = 0x4599
"""x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1 without its leading term."""
CRC_BITS = 15
CRC_MASK = 0x7FFF
HEADER_BITS = 19
"""Start bit, identifier, RTR, IDE, r0 and length code."""

STUFF_RUN = 5
"""Number of equal bits after which a bit of the opposite value is inserted."""

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


class Sent(NamedTuple):
    """What a transmitter has sent of a frame: its last bit, how many equal ones end with it, and all bits."""

    level: int
    run: int
    bits: int


@subroutine
def send(sent: Sent, bit: int) -> Sent:
    """Send a bit, and a stuff bit after five equal ones."""
    run = sent.run + 1 if bit == sent.level else 1
    if run == STUFF_RUN:
        return Sent(1 - bit, 1, sent.bits + 2)
    return Sent(bit, run, sent.bits + 1)


@subroutine
def content_bit(can_id: int, length: int, word: int, place: int) -> int:
    """A bit of header and data; `word`: the data, the first byte the lowest."""
    if place < HEADER_BITS:
        return (can_id << 7 | length) >> (HEADER_BITS - 1 - place) & 1
    place -= HEADER_BITS
    return word >> (place // 8 * 8 + 7 - place % 8) & 1


@subroutine
def checksum(can_id: int, length: int, word: int) -> int:
    """The checksum of a frame; `word`: its data, the first byte the lowest."""
    register = 0
    for place in range(HEADER_BITS + 8 * length):
        is_fed_back = register >> (CRC_BITS - 1) & 1 ^ content_bit(can_id, length, word, place)
        register = register << 1 & CRC_MASK
        if is_fed_back:
            register ^= CRC_POLYNOMIAL
    return register


@subroutine
def bits_on_wire(can_id: int, length: int, word: int) -> int:
    """The bits of a frame, start bit to intermission, stuff bits included; `word` as of `checksum`."""
    sent = Sent(1, 0, TAIL_BITS + INTERMISSION_BITS)
    for place in range(HEADER_BITS + 8 * length):
        sent = send(sent, content_bit(can_id, length, word, place))
    register = checksum(can_id, length, word)
    for place in range(CRC_BITS):
        sent = send(sent, register >> (CRC_BITS - 1 - place) & 1)
    return sent.bits


count_bits = jit(bits_on_wire)
"""`bits_on_wire` as Python calls it."""


def frame_bits(frame: Frame) -> int:
    """Return the bits that `frame` takes on the wire, start bit to intermission, stuff bits included.

    >>> frame_bits(Frame(0x123, bytes.fromhex("dead")))
    64
    """
    can_id, data = frame
    if not 0 <= can_id <= 0x7FF or len(data) > 8:
        raise ValueError(
            f"frame 0x{can_id:X} with {len(data)} data bytes is no classic CAN frame; "
            "wanted an identifier in 0…0x7FF and at most 8 bytes"
        )
    return count_bits(can_id, len(data), word_of(data))
