"""The arrival of the newest frame of each source, and the decision whether a new frame may be used.

Frames that fail their CRC, length or ranges, and frames that repeat the counter of the previous one, are
dropped and counted; the age of their source continues to grow. If a counter has a gap, the gap is counted and
the frame is used. After a silence in which the counter may have wrapped, an equal counter is no repetition.
"""

from typing import NamedTuple

from firmware_py.interface.frame import ACCEPTED, FrameErrorReason
from firmware_py.interface.framing import FrameKind, counter_of
from firmware_py.interface.zeroed import zeroed

NEVER_TICKS = 1_000_000
"""The age of a source that was never received."""


class Now(NamedTuple):
    """The number of the present tick, and the period of all ticks."""

    tick: int
    tick_s: float


class Arrival(NamedTuple):
    """The tick of a source's newest frame, and that frame's rolling counter (−1: none yet).

    `counted_tick` is the tick of the newest counter, dropped repetitions included.
    """

    tick: int = -NEVER_TICKS
    counted_tick: int = -NEVER_TICKS
    counter: int = -1


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


def age(tick: int, arrival: Arrival) -> int:
    """Ticks since a source's newest frame, at most `NEVER_TICKS`."""
    return min(tick - arrival.tick, NEVER_TICKS)


def accept(
    before: Arrival,
    counters: Counters,
    kind: FrameKind,
    reason: FrameErrorReason,
    word: int,
    now: Now,
) -> tuple[Arrival, Counters, bool]:
    """Decide whether a frame may be used: `(arrival, counters, usable)`; it counts no usable frames."""
    if reason != ACCEPTED:
        return before, count_refusal(counters, reason), False
    if kind.counter_bits == 0:
        return Arrival(now.tick, now.tick, -1), counters, True
    counter, modulus = counter_of(kind, word), 1 << kind.counter_bits
    # One period less than the counter's full turn, because frames jitter.
    turn_ticks = (modulus - 1) * max(kind.period_s / now.tick_s, 1.0)
    if counter == before.counter and now.tick - before.counted_tick < turn_ticks:
        counters = counters._replace(rejected_repeated=counters.rejected_repeated + 1)
        return Arrival(before.tick, now.tick, counter), counters, False
    if before.counter >= 0 and counter != (before.counter + 1) % modulus:
        counters = counters._replace(counter_gaps=counters.counter_gaps + 1)
    return Arrival(now.tick, now.tick, counter), counters, True
