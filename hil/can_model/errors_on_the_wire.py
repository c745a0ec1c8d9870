"""Position of an error on the wire and duration of its signalling, in bits.

A node that detects an error sends an error flag of 6 bits from the next bit on: dominant, or recessive if it
is error-passive. A dominant flag is itself an error for the other nodes (6 equal bits within the stuffed
part, or a dominant bit in the fixed-form part after it), and they answer with flags of their own. The
delimiter of 8 recessive bits follows the last flag, then the intermission (Bosch, "CAN Specification 2.0",
1991, part A, section 3.1).
"""

from collections.abc import Sequence

from firmware_py.interface.frame import Frame
from hil.can_model.bits import (
    BITS_BEFORE_DATA,
    CRC_BITS,
    END_OF_FRAME_BITS,
    INTERMISSION_BITS,
    STUFF_RUN,
    TAIL_BITS,
    arbitration_length,
    wire_bits,
)

DOMINANT, RECESSIVE = 0, 1
FLAG_BITS = 6
DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""Bits for which an error-passive node suspends transmission after a frame of its own."""

ACKNOWLEDGEMENT_SLOT = 1
ACKNOWLEDGEMENT_DELIMITER = 2
"""Bits of the fixed-form part, which follows the stuffed part; the checksum's delimiter is bit 0."""
UNKNOWN_LENGTH = 1000

RECESSIVE_TAIL_BITS = 1 + END_OF_FRAME_BITS + INTERMISSION_BITS
"""Acknowledgement delimiter to intermission: the run of recessive bits after every frame. An error
delimiter and its intermission have the same length."""


def disturbed_bit(frame: Frame, bits_after_arbitration: int) -> int:
    """Return the wire bit hit by a disturbance, no later than the last bit of the end of frame.

    The acknowledgement slot is skipped: in it the sender expects the bit of another node.
    """
    stuffed_bits = len(wire_bits(frame))
    bit = min(arbitration_length(frame) + bits_after_arbitration, stuffed_bits + TAIL_BITS - 1)
    return bit + 1 if bit == stuffed_bits + ACKNOWLEDGEMENT_SLOT else bit


class Reader:
    """Error detection of a receiver for one frame."""

    def __init__(self) -> None:
        self.bits: list[int] = []
        self.run, self.run_level = 0, RECESSIVE
        self.tail_bits = 0

    def finds_error(self, level: int) -> bool:
        """Receive the next bit and return whether it reveals an error.

        A disturbed frame that is received to its end has a wrong checksum.
        """
        stuff_bit_due = self.run == STUFF_RUN
        if len(self.bits) == self._length() and not stuff_bit_due:
            self.tail_bits += 1
            wanted = self.tail_bits != ACKNOWLEDGEMENT_SLOT + 1
            return self.tail_bits > ACKNOWLEDGEMENT_DELIMITER or (wanted and level == DOMINANT)
        if stuff_bit_due and level == self.run_level:
            return True
        if not stuff_bit_due:
            self.bits.append(level)
        self.run = self.run + 1 if level == self.run_level else 1
        self.run_level = level
        return False

    def _length(self) -> int:
        """Unstuffed bits from start bit to checksum; `UNKNOWN_LENGTH` before the length code is received."""
        if len(self.bits) < BITS_BEFORE_DATA:
            return UNKNOWN_LENGTH
        length_code = int("".join(map(str, self.bits[BITS_BEFORE_DATA - 4 : BITS_BEFORE_DATA])), 2)
        return BITS_BEFORE_DATA + 8 * min(length_code, 8) + CRC_BITS


def answer_delay(seen: Sequence[int], flag_level: int) -> int:
    """Return the number of bits from the disturbed bit until the receivers detect an error.

    `seen`: the wire bits up to the disturbed bit, which lies within the stuffed part. A flag of `flag_level`
    follows; the level is recessive also if an error-passive sender has stopped sending.

    >>> answer_delay((0, 1, 1, 0, 0), DOMINANT), answer_delay((0, 1, 0, 0, 0, 0, 0, 0), RECESSIVE)
    (4, 0)
    """
    reader = Reader()
    for level in seen:
        if reader.finds_error(level):
            return 0
    delay = 1
    while not reader.finds_error(flag_level):
        delay += 1
    return delay


def seen_when_disturbed(frame: Frame, bit: int) -> tuple[int, ...]:
    """Return the stuffed part up to and including `bit`, which is inverted; empty if `bit` lies after it."""
    wire = wire_bits(frame)
    return (*wire[:bit], 1 - wire[bit]) if bit < len(wire) else ()


def signalling_bits(answer_delays: Sequence[int]) -> int:
    """Return the total length of the error flags: the first, and the flags that answer it."""
    return FLAG_BITS + max(answer_delays, default=0)


def first_difference(wires: Sequence[Sequence[int]]) -> int:
    """Return the first bit in which frames with the same identifier differ on the wire."""
    return next(bit for bit, levels in enumerate(zip(*wires, strict=False)) if len(set(levels)) > 1)


def bits_to_contradiction(wire: Sequence[int], bit: int) -> int:
    """Return the bits after `bit` until the sender of `wire` sends recessive against a dominant flag."""
    ahead = wire[bit + 1 :]
    return 1 + next((bits for bits, level in enumerate(ahead) if level == RECESSIVE), len(ahead))
