"""How busy the bus is: frames in bits, over time."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

BITRATE_BIT_S = 1e6
"""Of the bench's classic CAN bus."""
LOAD_BIN_S = 0.1
"""The load over time is averaged over this long: the period of the slowest cyclic frames."""
TIME_RESOLUTION_S = 1e-6
"""Of candump's times."""


def bits_on_the_bus(length: NDArray[np.int64]) -> FloatArray:
    """Worst-case length in bits of frames of `length` data bytes, stuffing and inter-frame space included.

    11-bit identifiers: 55 + 10 n (Davis, Burns, Bril, Lukkien 2007).
    """
    return 55.0 + 10.0 * length.astype(np.float64)


def mean_load(length: NDArray[np.int64], duration_s: float) -> float | None:
    """Mean fraction of the bus's time that frames take, of a run of `duration_s`."""
    if len(length) == 0 or duration_s <= 0.0:
        return None
    return float(np.sum(bits_on_the_bus(length)) / (BITRATE_BIT_S * duration_s))


def load_by_bin(t_s: FloatArray, bits: FloatArray) -> dict[int, float]:
    """Bits in each bin of `LOAD_BIN_S` that holds a frame, by the bin's number."""
    numbers = np.floor((t_s + TIME_RESOLUTION_S) / LOAD_BIN_S).astype(np.int64)
    occupied, inverse = np.unique(numbers, return_inverse=True)
    return dict(zip(occupied.tolist(), np.bincount(inverse, weights=bits).tolist(), strict=True))


def load_over_time(bits_by_bin: Mapping[int, float]) -> tuple[FloatArray, FloatArray]:
    """Middle of each bin in seconds and its load, both of shape (bins,), in order of time."""
    numbers = np.array(sorted(bits_by_bin), np.int64)
    bits = np.array([bits_by_bin[number] for number in numbers.tolist()])
    middle_s: FloatArray = (numbers.astype(np.float64) + 0.5) * LOAD_BIN_S
    return middle_s, bits / (BITRATE_BIT_S * LOAD_BIN_S)
