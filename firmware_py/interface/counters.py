"""The firmware's counts of frames since power-up: accepted, refused, repeated or lost."""

from typing import NamedTuple

from firmware_py.interface.frame import FrameErrorReason
from firmware_py.interface.zeroed import zeroed


class Counters(NamedTuple):
    """Counts since power-up: frames accepted, frames dropped by reason, gaps in rolling counters, skipped
    ticks, and own frames lost to a full queue or to a value that cannot be encoded."""

    frames: int
    rejected_length: int
    rejected_crc: int
    rejected_value: int
    rejected_repeated: int
    counter_gaps: int
    skipped_ticks: int
    unsent: int


NOTHING_YET = zeroed(Counters)


def count_refusal(counters: Counters, reason: FrameErrorReason) -> Counters:
    """Count a frame that the codec refuses."""
    if reason == FrameErrorReason.LENGTH:
        return counters._replace(rejected_length=counters.rejected_length + 1)
    if reason == FrameErrorReason.CRC:
        return counters._replace(rejected_crc=counters.rejected_crc + 1)
    return counters._replace(rejected_value=counters.rejected_value + 1)


def count_frames(counters: Counters, frames: int, skipped_ticks: int, unsent: int) -> Counters:
    """Count accepted frames, skipped ticks and own frames that are not sent."""
    return counters._replace(
        frames=counters.frames + frames,
        skipped_ticks=counters.skipped_ticks + skipped_ticks,
        unsent=counters.unsent + unsent,
    )
