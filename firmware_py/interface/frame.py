"""A classic CAN data frame as both loops handle it: 11-bit identifier and at most eight bytes."""

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame: `can_id` in 0…0x7FF, `data` of 0…8 bytes."""

    can_id: int
    data: bytes


def worst_case_bits(length: int) -> int:
    """Return the bits that a frame with an 11-bit identifier and `length` data bytes takes at most.

    34 + 8·length bits are subject to stuffing, one stuff bit after every four in the worst case, and 13 more
    are not: the rest of the frame and the gap behind it (Davis et al., "Controller Area Network (CAN)
    schedulability analysis: Refuted, revisited and revised", 2007, eq. 1).

    >>> worst_case_bits(8)
    135
    """
    return 55 + 10 * length
