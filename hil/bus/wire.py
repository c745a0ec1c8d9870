"""Linux's `struct can_frame`, which kernel CAN sockets and the hub's streams carry.

Sixteen bytes: identifier with flags in its top bits, length, padding, eight data bytes.
"""

import struct
from collections.abc import Iterable

from firmware_py.interface.frame import Frame
from hil.bus.base import BusCounters

CAN_FRAME = struct.Struct("=IB3x8s")
FRAME_BYTES = CAN_FRAME.size
MAX_STANDARD_ID = 0x7FF
REMOTE_FLAG = 0x40000000
"""SocketCAN's, in the identifier of a remote frame."""
CONTROL_ID = 0xFFFFFFFF
"""Marks what passes between the hub and a node beside frames; no CAN frame can carry it."""
CONTROL_MARK = CONTROL_ID.to_bytes(4, "little")
STAMP_KIND, LOSS_KIND = 8, 9
"""Control records, by their length field: the wall clock in ns from here on, and a count of lost frames."""


def pack(frames: Iterable[Frame]) -> bytes:
    """The frames as `struct can_frame`s, one after another."""
    return b"".join([CAN_FRAME.pack(can_id, len(data), data) for can_id, data in frames])


def requests_in(accept: Iterable[int] | None) -> frozenset[int]:
    """Of the identifiers that a node takes those with the flag of a remote frame, without it."""
    return frozenset(can_id ^ REMOTE_FLAG for can_id in accept or () if can_id & REMOTE_FLAG)


def unpack(
    chunk: bytes | bytearray, counters: BusCounters, requests: frozenset[int] = frozenset()
) -> list[Frame]:
    """The data frames among the `struct can_frame`s of `chunk`, then the remote ones of `requests`, as empty.

    Others are counted as foreign.
    """
    frames = [
        Frame(can_id, data[:length])
        for can_id, length, data in CAN_FRAME.iter_unpack(chunk)
        if can_id <= MAX_STANDARD_ID
    ]
    if requests and len(chunk) > len(frames) * FRAME_BYTES:
        asked = (can_id ^ REMOTE_FLAG for can_id, _, _ in CAN_FRAME.iter_unpack(chunk))
        frames += [Frame(can_id, b"") for can_id in asked if can_id in requests]
    counters.foreign += len(chunk) // FRAME_BYTES - len(frames)
    return frames
