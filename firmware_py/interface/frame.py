"""A classic CAN data frame as both loops handle it: 11-bit identifier and at most eight bytes."""

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame: `can_id` in 0…0x7FF, `data` of 0…8 bytes."""

    can_id: int
    data: bytes
