"""Functions common to all frames: length, rolling counter, CRC-8, and the coding of numbers.

The CRC is that of SAE J1850: polynomial 0x1D, initial value and final XOR 0xFF, not reflected. The polynomial
is primitive, of period 255. The CRC of a frame covers at most 64 bits (the identifier's low byte and seven of
data), so it detects every one- and two-bit error and every burst of up to eight bits (Peterson and Brown,
"Cyclic Codes for Error Detection", 1961). The identifier is included so that a frame received under a wrong
identifier is detected.
"""

from typing import NamedTuple

from firmware_py.interface.float32 import FLOAT32_OVERFLOW, float32_bits, float32_of
from firmware_py.interface.frame import ACCEPTED, FrameErrorReason, WordFrame

CRC_POLYNOMIAL = 0x1D
CRC_INITIAL = 0xFF
CRC_FINAL_XOR = 0xFF


def shift_out(byte: int) -> int:
    """Remainder of `byte`·x⁸ divided by the polynomial."""
    remainder = byte
    for _ in range(8):
        carry = remainder & 0x80
        remainder = (remainder << 1) & 0xFF
        if carry:
            remainder ^= CRC_POLYNOMIAL
    return remainder


CRC_TABLE = bytes(shift_out(byte) for byte in range(256))


class FrameKind(NamedTuple):
    """The frames of one identifier; `length` in bytes.

    `period_s` is 0 for frames sent on an event, `counter_bits` is 0 for frames without counter and CRC.
    `register` is the CRC register after the identifier.
    """

    can_id: int
    length: int
    period_s: float
    counter_bits: int
    register: int


def checksum(kind: FrameKind, word: int) -> int:
    """The CRC-8 over the identifier's low byte and all bytes but the last; without a loop, for speed."""
    last = kind.length - 1
    register = kind.register
    if last >= 2:
        register = CRC_TABLE[CRC_TABLE[register ^ word & 0xFF] ^ word >> 8 & 0xFF]
    if last >= 4:
        register = CRC_TABLE[CRC_TABLE[register ^ word >> 16 & 0xFF] ^ word >> 24 & 0xFF]
    if last >= 6:
        register = CRC_TABLE[CRC_TABLE[register ^ word >> 32 & 0xFF] ^ word >> 40 & 0xFF]
    if last % 2 == 1:
        register = CRC_TABLE[register ^ word >> 8 * (last - 1) & 0xFF]
    return register ^ CRC_FINAL_XOR


def counter_of(kind: FrameKind, word: int) -> int:
    """The rolling counter: the bits directly below the last byte, the CRC."""
    return word >> 8 * (kind.length - 1) - kind.counter_bits & (1 << kind.counter_bits) - 1


def seal(kind: FrameKind, word: int, counter: int, sendable: bool) -> tuple[WordFrame, bool]:
    """`(frame, sendable)`: the word with counter and CRC, if the kind has them; word 0 if not sendable."""
    if not sendable:
        return WordFrame(kind.can_id, kind.length, 0), False
    if kind.counter_bits > 0:
        top = 8 * (kind.length - 1)
        word |= (counter & (1 << kind.counter_bits) - 1) << top - kind.counter_bits
        sealed = checksum(kind, word)
        word |= (signed(sealed, 8) if kind.length == 8 else sealed) << top
    return WordFrame(kind.can_id, kind.length, word), True


def check_frame(kind: FrameKind, length: int, word: int, listed: bool) -> FrameErrorReason:
    """The reason why a frame must not be used, or NONE. `listed`: the values of its signals are valid."""
    if length != kind.length:
        return FrameErrorReason.LENGTH
    if kind.counter_bits > 0 and checksum(kind, word) != word >> 8 * (kind.length - 1) & 0xFF:
        return FrameErrorReason.CRC
    return ACCEPTED if listed else FrameErrorReason.VALUE


def saturate(counts: float, low: int, high: int) -> int:
    """The whole number nearest to `counts`, limited to `low` and `high`; NaN gives `low`."""
    if low < counts < high:
        return round(counts)
    return high if counts > 0 else low


def signed(raw: int, bits: int) -> int:
    """The lowest `bits` of `raw` as a number in two's complement."""
    half = 1 << bits - 1
    return (raw & (1 << bits) - 1 ^ half) - half


def is_float32(value: float) -> bool:
    """Whether `value` is finite as a float32; NaN is not."""
    return -FLOAT32_OVERFLOW < value < FLOAT32_OVERFLOW


def float32_counts(value: float) -> int:
    """The 32 bits of the nearest float32; 0 if that is not finite."""
    return float32_bits(value) if is_float32(value) else 0


def float32_at(raw: int) -> float:
    """The value of the lowest 32 bits of `raw`; NaN and the infinities included."""
    return float32_of(raw & 0xFFFFFFFF)
