"""The load of the bus: bits of frames over time."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from firmware_py.interface.frame import worst_case_bits
from plant_sim.arrays import FloatArray, IntArray

BITRATE_BIT_S = 1e6
"""Bit rate of the bench's classic CAN bus."""
MOST_BYTES = 64
"""Largest number of data bytes in a log: those of CAN FD."""
FRAME_BITS = np.array([worst_case_bits(length) for length in range(MOST_BYTES + 1)], np.float64)
"""Worst-case length of a frame in bits by its number of data bytes."""
TENTH_S = 0.1
"""Averaging time of the load over time: the period of the slowest cyclic frames."""
TIME_RESOLUTION_S = 1e-6
"""Resolution of candump's times."""


class BusLoad(NamedTuple):
    """Bits in each tenth of a second with a frame: its number and its bits, shapes (tenths,)."""

    tenth: IntArray
    bits: FloatArray

    def mean(self, duration_s: float) -> float | None:
        """Mean share of the bus's time taken by frames in a run of `duration_s`; None without frames."""
        bits = float(self.bits.sum())
        return bits / (BITRATE_BIT_S * duration_s) if bits and duration_s > 0.0 else None

    @property
    def middle_s(self) -> FloatArray:
        """The middle of each tenth in s."""
        return (self.tenth.astype(np.float64) + 0.5) * TENTH_S

    @property
    def shares(self) -> FloatArray:
        """The share of each tenth that frames take."""
        return self.bits / (BITRATE_BIT_S * TENTH_S)


def load_of(t_s: FloatArray, length: IntArray) -> BusLoad:
    """The load by frames at `t_s` with `length` bytes, both of shape (n,)."""
    tenths = np.floor((t_s + TIME_RESOLUTION_S) / TENTH_S).astype(np.int64)
    return BusLoad(tenths, FRAME_BITS[length])


def load_from_log(middle_s: FloatArray, shares: FloatArray) -> BusLoad:
    """The load that a log has, exactly: each tenth has a whole number of bits."""
    tenths = np.floor(middle_s / TENTH_S).astype(np.int64)
    return BusLoad(tenths, np.round(shares * (BITRATE_BIT_S * TENTH_S)))


def sum_loads(loads: Iterable[BusLoad]) -> BusLoad:
    """The sum of loads, with each tenth once and in order of time."""
    parts = [BusLoad(np.zeros(0, np.int64), np.zeros(0)), *loads]
    tenth, row = np.unique(np.concatenate([part.tenth for part in parts]), return_inverse=True)
    bits = np.concatenate([part.bits for part in parts])
    return BusLoad(tenth, np.bincount(row, weights=bits, minlength=len(tenth)).astype(np.float64))
