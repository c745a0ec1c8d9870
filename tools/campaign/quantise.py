"""What a frame leaves of a value: counts of a scale within the codec's limits, or a float32."""

from typing import NamedTuple

import numpy as np

from firmware_py.interface import codec
from tools.campaign.kernels import subroutine


class Counts(NamedTuple):
    """A signal's scale and its limits in counts."""

    scale: float
    low: float
    high: float


def signal_counts(record: str, signal: str) -> Counts:
    """Scale and limits of a signal of the bus."""
    its_codec = next(one for kind, one in codec.CODECS.items() if kind.__name__ == record)
    described = its_codec.signals[signal]
    return Counts(float(described.scale), float(described.low_counts), float(described.high_counts))


@subroutine
def framed(counts: Counts, value: float) -> float:
    """The value that arrives: rounded to a count, saturated in counts."""
    count = float(np.rint(value / counts.scale))
    return min(max(count, counts.low), counts.high) * counts.scale


@subroutine
def single(value: float) -> float:
    """What a float32 of CANSimple keeps."""
    kept: float = np.float64(np.float32(value))
    return kept
