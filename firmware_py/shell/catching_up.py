"""The frames of missed periods: which of them belong to which period.

Frames carry no time of reception here, so the accelerometer's rolling counter dates them. It advances by one
in each period of the sensors. A sample that was sent before a pause is therefore not taken for a new one.
"""

from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.arrivals import Arrival
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.node.tick import MAX_RX

ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id
COUNTER_MODULUS = 1 << codec.ACCELEROMETER.kind.counter_bits
MOST_EARLY_TICKS = 3
"""Largest number of ticks by which the firmware's clock may lag behind the sensors'."""
LONGEST_DATED_TICKS = COUNTER_MODULUS - 1 - MOST_EARLY_TICKS
"""Longest time between two samples that their counters give."""


def is_sampled(frame: Frame) -> bool:
    """Whether a frame is part of a sample, which belongs to one period."""
    return frame.can_id in (ACCELEROMETER, ENCODER)


def sample_counter(frame: Frame) -> int | None:
    """The rolling counter of an accelerometer frame; None for another or a damaged frame."""
    if frame.can_id != ACCELEROMETER:
        return None
    try:
        codec.ACCELEROMETER.decode(frame.data)
    except FrameError:
        return None
    return codec.ACCELEROMETER.counter(frame.data)


def split_samples(frames: Sequence[Frame]) -> list[list[Frame]]:
    """The frames in groups with one sample each: an accelerometer frame and its encoder frame in any order.

    The other frames join the sample that they follow, or else the first one.
    """
    samples: list[list[Frame]] = [[]]
    for frame in frames:
        if is_sampled(frame) and any(other.can_id == frame.can_id for other in samples[-1]):
            samples.append([])
        samples[-1].append(frame)
    return samples


def due_counter(newest: Arrival, tick: int) -> int | None:
    """The counter of the sample that is due in `tick`, by the newest one so far; None if that is too old."""
    age_ticks = tick - newest.tick
    return (newest.counter + age_ticks) % COUNTER_MODULUS if age_ticks <= LONGEST_DATED_TICKS else None


def divide_frames(frames: Sequence[Frame], periods: int, due: int | None) -> list[list[Frame]]:
    """The frames of each of `periods` successive periods, in the order of their arrival.

    `due` is the counter of the sample that is due in the last period; None: that of the newest sample. Each
    sample belongs to the period that its counter gives; one without an accelerometer frame lies one period
    before its successor. Samples from before the first period belong to the first one, so that the gate
    judges them too, and samples of later periods to the last one.
    """
    found: list[list[Frame]] = [[] for _ in range(periods)]
    period = periods + 1
    for sample in reversed(split_samples(frames)):
        counter = next((one for one in map(sample_counter, sample) if one is not None), None)
        if counter is None:
            period -= 1
        else:
            due = counter if due is None else due
            behind_ticks = (due - counter) % COUNTER_MODULUS
            period = periods - (behind_ticks if behind_ticks <= LONGEST_DATED_TICKS else 0)
        found[max(period, 1) - 1][:0] = sample
    return found


def fit_frames(frames: Sequence[Frame]) -> Sequence[Frame]:
    """The frames of a period that fit `MAX_RX`: the newest ones, and the last of each identifier.

    An E-stop that is sent once, before many other frames, is therefore obeyed.
    """
    if len(frames) <= MAX_RX:
        return frames
    last = {frame[0]: place for place, frame in enumerate(frames) if frame[0] in RECEIVED_IDS}
    kept = set(last.values())
    others = [place for place in range(len(frames)) if place not in kept]
    kept.update(others[len(kept) - MAX_RX :])
    return [frames[place] for place in sorted(kept)]
