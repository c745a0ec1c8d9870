"""The frames of missed periods: which of them belong to which period.

Frames carry no time of reception here, so the accelerometer's rolling counter dates them. It advances by one
in each period of the sensors.
"""

from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.node.tick import MAX_RX

ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id
COUNTER_MODULUS = 1 << codec.ACCELEROMETER.kind.counter_bits
LONGEST_DATED_TICKS = COUNTER_MODULUS - 2
"""Longest time between two samples for which their counters give that time, to within one tick."""


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


def divide_frames(frames: Sequence[Frame], periods: int) -> list[list[Frame]]:
    """The frames of each of `periods` successive periods, in the order of their arrival.

    The newest sample belongs to the newest period, and each older one to the period that its counter gives. A
    sample without an accelerometer frame lies one period before its successor. Samples from before the first
    period belong to the first one, so that the gate judges them too.
    """
    found: list[list[Frame]] = [[] for _ in range(periods)]
    period, dated_period, dated_counter = periods + 1, 0, None
    for sample in reversed(split_samples(frames)):
        counter = next((one for one in map(sample_counter, sample) if one is not None), None)
        if counter is None or dated_counter is None:
            period -= 1
        else:
            period = dated_period - (dated_counter - counter) % COUNTER_MODULUS
        if counter is not None:
            dated_period, dated_counter = period, counter
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
