"""Pictures of signals over time as SVG within a page: state strips and plots, one below the other.

The curves are reduced to the extrema of `BINS` pieces, so that a page stays small and is written in
milliseconds; a plotting library would take longer to import than the run takes to judge.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray

WIDTH, LEFT, RIGHT = 1040.0, 84.0, 18.0
"""Width of a picture, and of its margins, in pixels of the page at 1280 px."""
STRIP_HEIGHT, HEADER, AXIS, GAP = 18.0, 18.0, 20.0, 6.0
"""Heights of a strip, of a plot's heading, of the time axis, and of the space between parts."""
BINS = 420
CHARACTER = 6.3
"""Mean width of a character in a strip."""


class Curve(NamedTuple):
    """Values over time; `style`: truth, estimate, target or bad; `dots`: points that are not joined."""

    t_s: FloatArray
    values: FloatArray
    style: str
    name: str
    dots: bool = False


class Level(NamedTuple):
    """A horizontal line: a limit with its name."""

    value: float
    name: str


class Plot(NamedTuple):
    """Curves over one axis of values; levels extend the axis so that all are visible."""

    title: str
    curves: Sequence[Curve]
    levels: Sequence[Level] = ()
    height: float = 96.0


class Span(NamedTuple):
    """A state that holds from one time to another, with its colour as RGBA."""

    from_s: float
    to_s: float
    text: str
    rgba: int


class Strip(NamedTuple):
    """States over time in one line."""

    title: str
    spans: Sequence[Span]


class Picture(NamedTuple):
    """All parts over one interval of time; `marks_s`: times of a vertical line through all plots."""

    label: str
    window_s: tuple[float, float]
    strips: Sequence[Strip]
    plots: Sequence[Plot]
    marks_s: Sequence[float] = ()


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values from `low` to `high`, at most `most` and one.

    >>> ticks(0.0, 0.93, 4), ticks(-0.2, 0.2, 3)
    ([0.0, 0.5], [-0.2, 0.0, 0.2])
    """
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        return [low]
    rough = span / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(one * power for one in (1.0, 2.0, 5.0, 10.0) if one * power >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(number * step, 12) for number in range(first, last + 1)]


def extrema(t_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The smallest and the largest value of each of `BINS` pieces, in order of time; all of a short curve."""
    finite = np.isfinite(values)
    t_s, values = t_s[finite], values[finite]
    if len(values) <= 2 * BINS:
        return t_s, values
    size = -(-len(values) // BINS)
    padded = np.append(values, np.full(-len(values) % size, values[-1])).reshape(-1, size)
    first = np.arange(len(padded)) * size
    rows = np.unique(np.concatenate([first + padded.argmin(axis=1), first + padded.argmax(axis=1)]))
    rows = rows[rows < len(values)]
    return t_s[rows], values[rows]


def path_of(x: FloatArray, y: FloatArray) -> str:
    """Points of a polyline in tenths of a pixel, without those within a horizontal line."""
    heights = np.round(y, 1)
    inner = (heights[1:-1] == heights[:-2]) & (heights[1:-1] == heights[2:])
    kept = np.concatenate([[True], ~inner, [True]])[: len(x)]
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[kept].tolist(), y[kept].tolist(), strict=True))


def text_color(rgba: int) -> str:
    """Black or white, whichever is legible on a colour."""
    red, green, blue = rgba >> 24, rgba >> 16 & 255, rgba >> 8 & 255
    return "#111" if 0.3 * red + 0.59 * green + 0.11 * blue > 140.0 else "#fff"


class Scale(NamedTuple):
    """A linear map from values to pixels."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: Any) -> Any:
        """The pixel of a value or of an array of values."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)


def strip_shapes(strip: Strip, x: Scale, top: float) -> dict[str, Any]:
    """The rectangles of a strip; a name that does not fit is shown when one points at it."""
    boxes = []
    for span in strip.spans:
        left, right = x(max(span.from_s, x.low)), x(min(span.to_s, x.high))
        if right > left:
            fits = len(span.text) * CHARACTER < right - left - 6.0
            box = {"x": left, "width": max(right - left, 1.5), "text": span.text, "fits": fits}
            boxes.append({**box, "fill": f"#{span.rgba >> 8:06x}", "ink": text_color(span.rgba)})
    return {"title": strip.title, "top": top, "boxes": boxes}


def plot_shapes(plot: Plot, x: Scale, top: float) -> dict[str, Any]:
    """The polylines, points, levels and ticks of a plot."""
    shown = []
    for curve in plot.curves:
        inside = (curve.t_s >= x.low) & (curve.t_s <= x.high)
        shown.append(extrema(curve.t_s[inside], curve.values[inside]))
    bounds = [level.value for level in plot.levels if math.isfinite(level.value)]
    values = np.concatenate([*(values for _, values in shown), bounds])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    y = Scale(low - margin, high + margin, top + HEADER + plot.height, top + HEADER)
    curves = []
    for curve, (t_s, kept) in zip(plot.curves, shown, strict=True):
        if curve.dots:
            drawn: Any = list(zip(x(t_s).round(1).tolist(), y(kept).round(1).tolist(), strict=True))
        else:
            drawn = path_of(x(t_s), y(kept))
        curves.append({"style": curve.style, "name": curve.name, "dots": curve.dots, "drawn": drawn})
    return {
        "title": plot.title,
        "top": top,
        "bottom": top + HEADER + plot.height,
        "curves": curves,
        "levels": [(round(y(one.value), 1), one.name) for one in plot.levels if math.isfinite(one.value)],
        "ticks": [(round(y(value), 1), f"{value:g}") for value in ticks(y.low, y.high, 4)],
    }


def shapes(picture: Picture) -> dict[str, Any]:
    """All parts of a picture in pixels, for the template `picture.svg.j2`."""
    x = Scale(*picture.window_s, LEFT, WIDTH - RIGHT)
    top, strips, plots = 0.0, [], []
    for strip in picture.strips:
        strips.append(strip_shapes(strip, x, top))
        top += STRIP_HEIGHT + 2.0
    first = top
    for plot in picture.plots:
        plots.append(plot_shapes(plot, x, top))
        top += HEADER + plot.height + GAP
    return {
        "label": picture.label,
        "width": WIDTH,
        "height": top + AXIS,
        "strips": strips,
        "strip_height": STRIP_HEIGHT,
        "plots": plots,
        "left": LEFT,
        "right": WIDTH - RIGHT,
        "marks": [(round(x(at_s), 1), first + HEADER, top - GAP) for at_s in picture.marks_s],
        "times": [(round(x(t_s), 1), f"{t_s:g}") for t_s in ticks(x.low, x.high, 12)],
        "bottom": top,
    }
