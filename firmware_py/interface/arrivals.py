"""The arrival of the newest frame of each source, and the decision whether a new frame may be used.

Frames that fail their CRC, length or ranges are dropped and counted; the age of their source continues to
grow. So are frames that repeat the newest one, and frames out of sequence, whose rolling counter the source
cannot have reached in the time since: a recorded frame, or one of a second sender, is no sign of life. A lost
frame costs nothing but itself, because the next one continues the sequence. The first frame after power-up
begins a sequence; a later one begins with the third frame in order, none of the old one being in between.
"""

from typing import NamedTuple

from firmware_py.interface.frame import ACCEPTED, FrameErrorReason
from firmware_py.interface.framing import FrameKind, counter_of
from firmware_py.interface.zeroed import zeroed

NEVER_TICKS = 1_000_000
"""The age of a source that was never received."""
EVERY_TICK_S = 0.001
"""Period in `vibro.dbc` of a frame that is sent in every tick."""
LONGEST_DELAY_S = 0.020
"""Longest delay of a frame against the one before it: a sender that was held up sends all that is due."""
NEW_SEQUENCE = 3
"""Frames in order that begin a new sequence."""


class Now(NamedTuple):
    """The number of the present tick, and the period of all ticks."""

    tick: int
    tick_s: float


class Arrival(NamedTuple):
    """The tick of a source's newest frame in sequence, its rolling counter (−1: none yet) and its word.

    `counter` of frames without a rolling counter: how many different ones this tick has brought.
    `stray_tick`, `stray_counter`: those of the newest frame out of sequence. `strays`: the number of the
    newest such frames that follow each other.
    """

    tick: int = -NEVER_TICKS
    counter: int = -1
    word: int = 0
    stray_tick: int = -NEVER_TICKS
    stray_counter: int = -1
    strays: int = 0


class Counters(NamedTuple):
    """Counts since power-up: frames accepted, frames dropped by reason, gaps in rolling counters, sequences
    that began anew, skipped ticks, and own frames lost to a full queue or to a value that cannot be encoded.
    """

    frames: int
    rejected_length: int
    rejected_crc: int
    rejected_value: int
    rejected_repeated: int
    rejected_sequence: int
    counter_gaps: int
    new_sequences: int
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


def stray_age(tick: int, arrival: Arrival) -> int:
    """Ticks since a source's newest frame out of sequence, at most `NEVER_TICKS`."""
    return min(tick - arrival.stray_tick, NEVER_TICKS)


def continues(kind: FrameKind, step: int, age_ticks: int, tick_s: float) -> bool:
    """Whether a source can have counted on by `step` in the time since its newest frame.

    After half a turn of the counter a step does not distinguish an older frame from a newer one.
    """
    period_s = tick_s if kind.period_s <= EVERY_TICK_S else kind.period_s
    elapsed_s = age_ticks * tick_s + LONGEST_DELAY_S
    return step > 0 and (step - 1) * period_s <= elapsed_s < (1 << kind.counter_bits - 1) * period_s


def accept(
    before: Arrival, counters: Counters, kind: FrameKind, reason: FrameErrorReason, word: int, now: Now
) -> tuple[Arrival, Counters, bool]:
    """Decide whether a frame may be used: `(arrival, counters, usable)`; it counts no usable frames."""
    if reason != ACCEPTED:
        return before, count_refusal(counters, reason), False
    if kind.counter_bits == 0:
        number = before.counter + (0 if word == before.word else 1) if before.tick == now.tick else 1
        return before._replace(tick=now.tick, counter=number, word=word), counters, True
    counter, modulus = counter_of(kind, word), 1 << kind.counter_bits
    if counter == before.counter and word == before.word:
        return before, counters._replace(rejected_repeated=counters.rejected_repeated + 1), False
    accepted = before._replace(tick=now.tick, counter=counter, word=word, strays=0)
    is_first, step = before.counter < 0, (counter - before.counter) % modulus
    if is_first or continues(kind, step, now.tick - before.tick, now.tick_s):
        gaps = counters.counter_gaps + (0 if is_first or step == 1 else 1)
        return accepted, counters._replace(counter_gaps=gaps), True
    step = (counter - before.stray_counter) % modulus
    follows = before.strays > 0 and continues(kind, step, now.tick - before.stray_tick, now.tick_s)
    strays = before.strays + 1 if follows else 1
    if strays == NEW_SEQUENCE:
        counters = counters._replace(new_sequences=counters.new_sequences + 1)
        return accepted._replace(stray_tick=now.tick), counters, True
    counters = counters._replace(rejected_sequence=counters.rejected_sequence + 1)
    return before._replace(stray_tick=now.tick, stray_counter=counter, strays=strays), counters, False
