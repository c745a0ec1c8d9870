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
"""SocketCAN's flag in the identifier of a remote frame."""
CONTROL_ID = 0xFFFFFFFF
"""Identifier of control records between the hub and a node; no CAN frame can have it."""
CONTROL_MARK = CONTROL_ID.to_bytes(4, "little")
STAMP_KIND, LOSS_KIND = 8, 9
"""Length field of a control record: wall clock in ns of the frames after it, or a count of lost frames."""
DUE_KIND, TURN_KIND, END_KIND = 10, 11, 12
"""Of the pacemaker: when a turn was due in ns, and its tick. Of a node at its turn's end: `TURN_END`."""
TURN_END = struct.Struct("<II")
"""The CPU time of a turn in µs, and the tick of the node's next turn."""


def control(kind: int, value: int | bytes) -> bytes:
    """Pack a control record of the stream between hub and node."""
    data = value if isinstance(value, bytes) else value.to_bytes(8, "little")
    return CAN_FRAME.pack(CONTROL_ID, kind, data)


def whole_frames(chunk: bytes) -> tuple[bytes, bytes]:
    """Split what a stream has brought: its whole frames, and the beginning of the next one."""
    whole = len(chunk) - len(chunk) % FRAME_BYTES
    return chunk[:whole], chunk[whole:]


def pack(frames: Iterable[Frame]) -> bytes:
    """The frames as `struct can_frame`s, one after another."""
    return b"".join([CAN_FRAME.pack(can_id, len(data), data) for can_id, data in frames])


def requests_in(accept: Iterable[int] | None) -> frozenset[int]:
    """The accepted identifiers that carry the remote flag, with the flag removed."""
    return frozenset(can_id ^ REMOTE_FLAG for can_id in accept or () if can_id & REMOTE_FLAG)


def unpack(
    chunk: bytes | bytearray, counters: BusCounters, requests: frozenset[int] = frozenset()
) -> list[Frame]:
    """Unpack the data frames in `chunk`, then its remote frames of `requests` as empty frames.

    All other frames are counted as foreign.
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
