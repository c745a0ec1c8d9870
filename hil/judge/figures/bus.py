"""The load of the bus: bits of frames over time."""

from collections.abc import Mapping

import numpy as np

from hil.record.candump import TENTH_S, BusCounts
from plant_sim.arrays import FloatArray

BITRATE_BIT_S = 1e6
"""Bit rate of the bench's classic CAN bus."""
HEAD_BITS, BITS_A_BYTE = 55.0, 10.0
"""Worst-case length in bits of a frame and of each data byte, with stuffing and the space between frames.

11-bit identifiers: 55 + 10 n (Davis, Burns, Bril, Lukkien 2007).
"""


def mean_load(counts: BusCounts, duration_s: float) -> float | None:
    """Mean share of the bus's time taken by frames in a run of `duration_s`; None without frames."""
    bits = sum(bits_by_tenth(counts).values())
    return bits / (BITRATE_BIT_S * duration_s) if counts.total and duration_s > 0.0 else None


def bits_by_tenth(counts: BusCounts) -> dict[int, float]:
    """Bits in each tenth of a second with a frame, by its number."""
    bits = HEAD_BITS * counts.frames + BITS_A_BYTE * counts.frame_bytes
    return dict(zip(counts.tenth.tolist(), bits.tolist(), strict=True))


def load_over_time(bits_by_tenth: Mapping[int, float]) -> tuple[FloatArray, FloatArray]:
    """Middle of each tenth in seconds and its load, both of shape (tenths,), in order of time."""
    numbers = np.array(sorted(bits_by_tenth), np.int64)
    bits = np.array([bits_by_tenth[number] for number in numbers.tolist()])
    middle_s: FloatArray = (numbers.astype(np.float64) + 0.5) * TENTH_S
    return middle_s, bits / (BITRATE_BIT_S * TENTH_S)
