"""What the firmware counts of its bus since power-up: frames taken, refused, repeated or lost."""

from typing import NamedTuple

from firmware_py.interface.errors import FrameErrorReason


class Counters(NamedTuple):
    """Since power-up: frames taken, frames dropped by reason, gaps in rolling counters, skipped ticks, and
    own frames that found no place in the queue or could not be encoded."""

    frames: int
    rejected_length: int
    rejected_crc: int
    rejected_value: int
    rejected_repeated: int
    counter_gaps: int
    skipped_ticks: int
    unsent: int


NOTHING_YET = Counters(0, 0, 0, 0, 0, 0, 0, 0)


def refused(counters: Counters, reason: FrameErrorReason) -> Counters:
    """Count a frame that the codec refuses."""
    frames, length, crc, value, repeated, gaps, skipped, unsent = counters
    if reason == FrameErrorReason.LENGTH:
        length += 1
    elif reason == FrameErrorReason.CRC:
        crc += 1
    else:
        value += 1
    return Counters(frames, length, crc, value, repeated, gaps, skipped, unsent)


def counted(counters: Counters, repeated: bool, gap: bool) -> Counters:
    """Count a frame that the codec accepts."""
    return Counters(
        counters.frames if repeated else counters.frames + 1,
        counters.rejected_length,
        counters.rejected_crc,
        counters.rejected_value,
        counters.rejected_repeated + 1 if repeated else counters.rejected_repeated,
        counters.counter_gaps + 1 if gap else counters.counter_gaps,
        counters.skipped_ticks,
        counters.unsent,
    )


def also_counted(counters: Counters, skipped_ticks: int, unsent: int) -> Counters:
    """Count skipped ticks and own frames that do not leave."""
    return Counters(
        counters.frames,
        counters.rejected_length,
        counters.rejected_crc,
        counters.rejected_value,
        counters.rejected_repeated,
        counters.counter_gaps,
        counters.skipped_ticks + skipped_ticks,
        counters.unsent + unsent,
    )
