"""Ranges of the plotted values, rounded so that the axis of each plot has at least two labels.

Rerun labels an axis at round numbers that its height has room for, which in a low plot are the powers of ten
alone. Its own range ends at the data, and so may contain one label or none.
"""

import math
from collections.abc import Iterable

import numpy as np

from plant_sim.arrays import FloatArray

Extent = tuple[float, float]
MOST_STEPS = 6
"""Largest number of steps of a power of ten; a plot with the height of four lines of text labels them all."""
MARGIN = 0.04
"""Share of the range that is added at both ends, so that the labels there are drawn whole."""


class Extents:
    """The smallest and largest value of each signal, by the names `/plant.x_m` and `/stop`."""

    def __init__(self) -> None:
        self._found: dict[str, Extent] = {}

    def add(self, name: str, values: FloatArray) -> None:
        """Extend the range of a signal; values that are not finite are left out."""
        finite = values[np.isfinite(values)]
        if len(finite):
            low, high = self._found.get(name, (math.inf, -math.inf))
            self._found[name] = min(low, float(finite.min())), max(high, float(finite.max()))

    def of(self, names: Iterable[str]) -> Extent | None:
        """The rounded range of several signals together; None if none of them has a value."""
        found = [self._found[name] for name in names if name in self._found]
        if not found:
            return None
        return rounded(min(low for low, _ in found), max(high for _, high in found))


def rounded(low: float, high: float) -> Extent:
    """A range that contains both values and ends at multiples of a power of ten, with a margin.

    >>> rounded(0.36, 0.92), rounded(0.025, 0.18)
    ((-0.04, 1.04), (-0.008, 0.208))
    """
    span = high - low or max(abs(low), abs(high)) or 1.0
    step = 10.0 ** math.floor(math.log10(span))
    if math.ceil(high / step) - math.floor(low / step) > MOST_STEPS:
        step *= 10.0
    bottom, top = math.floor(low / step) * step, math.ceil(high / step) * step
    if bottom == top:
        bottom, top = bottom - step, top + step
    margin = MARGIN * (top - bottom)
    return round(bottom - margin, 12), round(top + margin, 12)
