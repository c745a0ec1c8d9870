"""What every plot of a report is drawn with: colours, a figure with its axes, thinned curves."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hil.record import state_timeline
from hil.show.report.axes import Axes
from plant_sim.arrays import FloatArray


def css(rgba: int) -> str:
    """One of the log's colours as a page writes it.

    >>> css(0x56B4E9FF)
    '#56b4e9'
    """
    return f"#{rgba >> 8:06x}"


TRUTH, ESTIMATE, TARGET, OTHER, ALARM, GOOD = map(css, state_timeline.PALETTE)
MOST_POINTS = 2400
"""A curve has no more points than a wide screen has pixels to show them."""
LEFT_PX, RIGHT_PX, BOTTOM_PX, TOP_PX = 72, 10, 44, 10
"""Margins for an axis with its name."""
BELOW_PX = 14
"""From one plot to the next below."""


class Plot(NamedTuple):
    """A drawing with the sentence that says what it shows."""

    title: str
    caption: str
    svg: str
    half: bool = False
    """Whether two of its kind stand side by side."""


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At most `MOST_POINTS` rows, the extremes of `values` among them; all of shape (n,)."""
    if len(t) <= MOST_POINTS:
        return t, values
    edges = np.linspace(0, len(t), MOST_POINTS // 2 + 1).astype(int)
    rows: list[int] = []
    for low, high in itertools.pairwise(edges.tolist()):
        block = values[low:high]
        rows += sorted({low + int(np.argmin(block)), low + int(np.argmax(block))})
    return t[rows], values[rows]


class Figure:
    """Axes on a drawing of this width and height in pixels; `name`: a word for what it shows."""

    def __init__(self, name: str, width: float, height: float) -> None:
        self.name, self.width, self.height = name, width, height
        self.axes: list[Axes] = []

    def add(self, left: float, top: float, width: float, height: float) -> Axes:
        """One more rectangle."""
        self.axes.append(Axes(left, top, width, height))
        return self.axes[-1]

    def stacked(
        self,
        *heights: float,
        left: float = LEFT_PX,
        right: float = RIGHT_PX,
        top: float = TOP_PX,
    ) -> list[Axes]:
        """Axes of these relative heights one below the other, which share the lowest one's scale of x."""
        free = self.height - top - BOTTOM_PX - BELOW_PX * (len(heights) - 1)
        found: list[Axes] = []
        for share in heights:
            height = free * share / sum(heights)
            found.append(self.add(left, top, self.width - left - right, height))
            top += height + BELOW_PX
        for axes in found[:-1]:
            axes.x, axes.numbers_x = found[-1].x, False
        return found

    def beside(self, count: int) -> list[Axes]:
        """This number of axes side by side."""
        width = self.width / count
        return [
            self.add(
                number * width + LEFT_PX, TOP_PX, width - LEFT_PX - RIGHT_PX, self.height - TOP_PX - BOTTOM_PX
            )
            for number in range(count)
        ]

    def on_the_right_of(self, axes: Axes) -> Axes:
        """A second scale of y for the same rectangle, on its right."""
        second = self.add(axes.left, axes.top, axes.width, axes.height)
        second.x, second.on_the_right, second.numbers_x = axes.x, True, False
        return second

    def svg(self) -> str:
        """The figure as an SVG element whose colours follow the page."""
        drawn: Sequence[str] = [axes.svg(f"{self.name}-{number}") for number, axes in enumerate(self.axes)]
        size = f'viewBox="0 0 {self.width:g} {self.height:g}" width="{self.width:g}" height="{self.height:g}"'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
            f'font-family="sans-serif" stroke-linejoin="round">{"".join(drawn)}</svg>'
        )
