"""Axes of a plot, drawn as SVG: scales with ticks, curves, points, bars, lines across, a legend.

No more than the report's plots need; what a plotting library makes of the same takes fifty times as long, and
a suite has a hundred reports. All sizes are pixels, y downwards.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plant_sim.arrays import FloatArray, IntArray

Counts = IntArray

INK, FAINT = "var(--ink)", "var(--faint)"
"""The page's own colours, which differ in the dark."""
TEXT_PX, LEGEND_PX, LETTER_PX = 12, 11, 5.6
TICK_PX, BETWEEN_TICKS_PX = 4, {"x": 70.0, "y": 26.0}
MARGIN = 0.05
"""Of the data's span, left free on both sides."""
LOG_MARGIN = 0.12
"""Of its decades: a legend has its place above."""
DASHED, DOTTED = "5 3", "1 3"
FEW_DECADES, MOST_DECADES = 2, 5
Range = tuple[float, float]
Corner = Literal["upper left", "upper right", "lower left", "lower right", "above"]


def number(value: float, decimals: int) -> str:
    """A tick's number, with the sign that is as wide as a digit.

    >>> number(-0.25, 2), number(-0.0, 1), number(1200.0, 0)
    ('−0.25', '0.0', '1200')
    """
    return f"{value + 0.0:.{decimals}f}".replace("-", "−")


def steps(low: float, high: float, most: float, whole: bool = False) -> tuple[list[float], int]:
    """Round numbers from `low` to `high`, at most about `most`, and how many decimals they need.

    >>> steps(-0.1, 2.2, 5)
    ([0.0, 0.5, 1.0, 1.5, 2.0], 1)
    >>> steps(0.0, 0.6, 5, whole=True)
    ([0.0], 0)
    """
    least = max((high - low) / max(most, 1.0), 1e-12)
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * one for one in (1.0, 2.0, 2.5, 5.0, 10.0) if power * one >= least * (1.0 - 1e-9))
    if whole:
        step = max(1.0, round(step))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    decimals += round(step, decimals) != round(step, decimals + 1)
    return [round(step * count, decimals) + 0.0 for count in range(first, last + 1)], decimals


def escaped(text: str) -> str:
    """Text as XML takes it."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def text_at(
    x: float,
    y: float,
    text: str,
    anchor: str = "start",
    color: str = INK,
    size: int = TEXT_PX,
    turn: bool = False,
) -> str:
    """A word whose baseline is at `y`; `turn`: upwards."""
    turned = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turn else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turned} '
        f'style="fill:{color};font-size:{size}px">{escaped(text)}</text>'
    )


def stroke(color: str, width: float, dash: str = "") -> str:
    """The style of a line."""
    dashes = f";stroke-dasharray:{dash}" if dash else ""
    return f'style="fill:none;stroke:{color};stroke-width:{width}{dashes}"'


class Scale(NamedTuple):
    """From values to pixels."""

    low: float
    high: float
    start_px: float
    end_px: float
    is_log: bool = False

    def px(self, values: ArrayLike) -> FloatArray:
        """Where values are."""
        found: FloatArray = np.asarray(values, np.float64)
        low, high = self.low, self.high
        if self.is_log:
            found, low, high = np.log10(np.maximum(found, low)), math.log10(low), math.log10(high)
        return self.start_px + (self.end_px - self.start_px) * (found - low) / (high - low)

    def ticks(self, most: float, whole: bool = False) -> list[tuple[float, str]]:
        """Values and their numbers; decades where the scale is logarithmic, twos and fives too within few."""
        low, high = sorted((self.low, self.high))
        if not self.is_log:
            values, decimals = steps(low, high, most, whole)
            return [(value, number(value, decimals)) for value in values]
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        every = max(1, math.ceil((last - first) / MOST_DECADES))
        factors = (1.0, 2.0, 5.0) if last - first <= FEW_DECADES else (1.0,)
        values = [one * 10.0**power for power in range(first, last + 1, every) for one in factors]
        return [(value, f"{value:g}") for value in values if low <= value <= high]


class Extent:
    """What a scale has to hold: all that was drawn, or a range that is given."""

    def __init__(self) -> None:
        self._low, self._high = math.inf, -math.inf
        self.fixed: Range | None = None
        self.from_zero = self.is_log = False

    def add(self, values: ArrayLike) -> None:
        """Let the scale hold these, those that are not finite left out."""
        found = np.asarray(values, np.float64)
        found = found[np.isfinite(found) & ((found > 0.0) | (not self.is_log))]
        if found.size:
            self._low, self._high = min(self._low, float(found.min())), max(self._high, float(found.max()))

    def range(self) -> Range:
        """The lowest and the highest value of the scale."""
        if self.fixed is not None:
            return self.fixed
        low, high = (self._low, self._high) if self._low <= self._high else (0.0, 1.0)
        if self.is_log:
            free = max((high / low) ** LOG_MARGIN, 1.2)
            return low / free, high * free
        if self.from_zero:
            low = 0.0
        free = MARGIN * (high - low) or 0.05 * abs(high) or 1.0
        return (low if self.from_zero else low - free), high + free


class Axes:
    """One rectangle of a figure; what is drawn first is below."""

    def __init__(self, left: float, top: float, width: float, height: float) -> None:
        self.left, self.top, self.width, self.height = left, top, width, height
        self.x, self.y = Extent(), Extent()
        self.x_label = self.y_label = ""
        self.y_color = INK
        self.y_names: Sequence[str] | None = None
        """In the place of numbers: the names of 0, 1, …"""
        self.numbers_x = self.grid = True
        self.whole_y = False
        self.on_the_right = False
        """The scale of y is on the right, and there is none of x."""
        self.legend: Corner | None = None
        self._marks: list[Callable[[Scale, Scale], str]] = []
        self.named: list[tuple[str, str, str]] = []
        """Of the legend: a name, the style of its line and its shape."""
        self._said: str | None = None

    def say(self, text: str) -> None:
        """Nothing but a sentence."""
        self._said = text

    def curve(
        self, x: ArrayLike, y: ArrayLike, color: str, label: str = "", width: float = 1.2, dash: str = ""
    ) -> None:
        """A line through points, broken where they are not finite."""
        self.x.add(x)
        self.y.add(y)
        self._name(label, stroke(color, max(width, 1.4), dash))

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            return f'<path d="{path(scale_x.px(x), scale_y.px(y))}" {stroke(color, width, dash)}/>'

        self._marks.append(mark)

    def points(self, x: ArrayLike, y: ArrayLike, color: str, label: str = "", cross: bool = False) -> None:
        """Dots, or crosses."""
        self.x.add(x)
        self.y.add(y)
        shape = "m-2.5-2.5 5 5m0-5-5 5" if cross else "m0 0h0"
        look = stroke(color, 1.3) if cross else stroke(color, 4.5)[:-1] + ';stroke-linecap:round"'
        self._name(label, look, shape)

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            places = zip(scale_x.px(x).tolist(), scale_y.px(y).tolist(), strict=True)
            each = "".join(f"M{at_x:.1f} {at_y:.1f}{shape}" for at_x, at_y in places if math.isfinite(at_y))
            return f'<path d="{each}" {look}/>'

        self._marks.append(mark)

    def segments(
        self, from_xy: tuple[ArrayLike, ArrayLike], to_xy: tuple[ArrayLike, ArrayLike], look: str
    ) -> None:
        """Straight lines from points to points."""
        for x, y in (from_xy, to_xy):
            self.x.add(x)
            self.y.add(y)

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            ends = (
                scale_x.px(from_xy[0]),
                scale_y.px(from_xy[1]),
                scale_x.px(to_xy[0]),
                scale_y.px(to_xy[1]),
            )
            rows = zip(*(np.atleast_1d(end).tolist() for end in ends), strict=True)
            return f'<path d="{"".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for a, b, c, d in rows)}" {look}/>'

        self._marks.append(mark)

    def across(
        self,
        at: float,
        color: str,
        upright: bool = False,
        label: str = "",
        width: float = 1.1,
        dash: str = "",
    ) -> None:
        """A line through the whole rectangle: along x, or `upright`."""
        (self.x if upright else self.y).add(at)
        self._name(label, stroke(color, width, dash))

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            if upright:
                line = f"M{float(scale_x.px(at)):.1f} {scale_y.start_px:.1f}V{scale_y.end_px:.1f}"
            else:
                line = f"M{scale_x.start_px:.1f} {float(scale_y.px(at)):.1f}H{scale_x.end_px:.1f}"
            return f'<path d="{line}" {stroke(color, width, dash)}/>'

        self._marks.append(mark)

    def band(self, from_x: float, to_x: float, color: str, opacity: float) -> None:
        """A stretch of x, shaded over the whole height."""

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            ends = scale_x.px([from_x, to_x])
            return rectangle(ends, np.array([scale_y.start_px, scale_y.end_px]), color, opacity)

        self._marks.append(mark)

    def boxes(self, x: FloatArray, y: FloatArray, color: str) -> None:
        """Filled rectangles, low and high ends in rows: both of shape (n, 2)."""
        self.x.add(x)
        self.y.add(y)

        def mark(scale_x: Scale, scale_y: Scale) -> str:
            rows = zip(scale_x.px(x), scale_y.px(y), strict=True)
            return "".join(rectangle(ends_x, ends_y, color) for ends_x, ends_y in rows)

        self._marks.append(mark)

    def bars(self, counts: Counts, edges: FloatArray, color: str, below: Counts | int = 0) -> None:
        """A histogram, on top of the counts `below`."""
        tops = below + counts
        some = counts > 0
        y = np.column_stack([np.broadcast_to(below, counts.shape), tops])
        self.x.add(edges)
        self.y.add(0.0)
        self.boxes(np.column_stack([edges[:-1], edges[1:]])[some], y[some].astype(np.float64), color)

    def outline(self, counts: Counts, edges: FloatArray, color: str, label: str) -> None:
        """A histogram's outline."""
        heights = np.concatenate([[0], np.repeat(counts, 2), [0]]).astype(np.float64)
        self.curve(np.repeat(edges, 2), heights, color, label)

    def word(self, x: float, y: float, text: str, color: str) -> None:
        """A word to the right of a point, at its height."""
        self._marks.append(
            lambda scale_x, scale_y: text_at(
                float(scale_x.px(x)) + 4.0, float(scale_y.px(y)) + 4.0, text, color=color, size=LEGEND_PX
            )
        )

    def svg(self, name: str) -> str:
        """All of it; `name`: of the clipping, once a page."""
        if self._said is not None:
            return text_at(self.left + self.width / 2, self.top + self.height / 2, self._said, "middle")
        right, bottom = self.left + self.width, self.top + self.height
        scale_x = Scale(*self.x.range(), self.left, right, self.x.is_log)
        scale_y = Scale(*self.y.range(), bottom, self.top, self.y.is_log)
        inside = f'<rect x="{self.left}" y="{self.top}" width="{self.width}" height="{self.height}"/>'
        drawn = "".join(mark(scale_x, scale_y) for mark in self._marks)
        return (
            f'<clipPath id="{name}">{inside}</clipPath>{self._frame(scale_x, scale_y)}'
            f'<g clip-path="url(#{name})">{drawn}</g>{self._legend()}'
        )

    def _name(self, label: str, look: str, shape: str = "") -> None:
        if label:
            self.named.append((label, look, shape))

    def _frame(self, scale_x: Scale, scale_y: Scale) -> str:
        """Spines, grid, ticks, their numbers and the names of the axes."""
        right, bottom = self.left + self.width, self.top + self.height
        ticks_x = [] if self.on_the_right else scale_x.ticks(self.width / BETWEEN_TICKS_PX["x"])
        if self.y_names is None:
            ticks_y = scale_y.ticks(self.height / BETWEEN_TICKS_PX["y"], self.whole_y)
        else:
            ticks_y = [(float(at), name) for at, name in enumerate(self.y_names)]
        places_x = [(float(scale_x.px(value)), text) for value, text in ticks_x]
        places_y = [(float(scale_y.px(value)), text) for value, text in ticks_y]
        spine = right if self.on_the_right else self.left
        out = TICK_PX if self.on_the_right else -TICK_PX
        marks = f"M{spine:.1f} {self.top:.1f}V{bottom:.1f}" + "".join(
            f"M{spine:.1f} {y:.1f}h{out}" for y, _ in places_y
        )
        parts = []
        if not self.on_the_right:
            marks += f"M{self.left:.1f} {bottom:.1f}H{right:.1f}"
            marks += "".join(f"M{x:.1f} {bottom:.1f}v{TICK_PX}" for x, _ in places_x)
        if self.grid and not self.on_the_right:
            lines = "".join(f"M{x:.1f} {self.top:.1f}V{bottom:.1f}" for x, _ in places_x)
            lines += "".join(f"M{self.left:.1f} {y:.1f}H{right:.1f}" for y, _ in places_y)
            parts.append(f'<path d="{lines}" opacity="0.25" {stroke(FAINT, 0.8)}/>')
        parts.append(f'<path d="{marks}" {stroke(FAINT, 1.0)}/>')
        if self.numbers_x:
            parts += [text_at(x, bottom + 17.0, text, "middle") for x, text in places_x]
        anchor = "start" if self.on_the_right else "end"
        parts += [text_at(spine + 1.75 * out, y + 4.0, text, anchor) for y, text in places_y]
        if self.x_label:
            parts.append(text_at(self.left + self.width / 2, bottom + 34.0, self.x_label, "middle"))
        if self.y_label:
            x = spine + 46.0 if self.on_the_right else spine - 46.0
            middle = self.top + self.height / 2
            parts.append(text_at(x, middle, self.y_label, "middle", self.y_color, turn=True))
        return "".join(parts)

    def _legend(self) -> str:
        if self.legend is None or not self.named:
            return ""
        widths = [34.0 + LETTER_PX * len(label) for label, _, _ in self.named]
        x = self.left + 8.0
        if self.legend.endswith("right"):
            x = self.left + self.width - sum(widths)
        y = self.top + self.height - 9.0 if self.legend.startswith("lower") else self.top + 11.0
        if self.legend == "above":
            x, y = self.left, self.top - 8.0
        parts = []
        for (label, look, shape), width in zip(self.named, widths, strict=True):
            swatch = f"M{x + 8.0:.1f} {y:.1f}{shape}" if shape else f"M{x:.1f} {y:.1f}h16"
            parts += [f'<path d="{swatch}" {look}/>', text_at(x + 21.0, y + 4.0, label, size=LEGEND_PX)]
            x += width
        return "".join(parts)


def path(x: FloatArray, y: FloatArray) -> str:
    """An SVG path through points, broken where they are not finite; points that fall together are one."""
    rows: Iterable[tuple[float, float]] = zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True)
    parts: list[str] = []
    before: tuple[float, float] | None = None
    for row in rows:
        if not (math.isfinite(row[0]) and math.isfinite(row[1])):
            before = None
        elif row != before:
            parts.append(f"{'M' if before is None else 'L'}{row[0]:g} {row[1]:g}")
            before = row
    return "".join(parts)


def rectangle(x: FloatArray, y: FloatArray, color: str, opacity: float = 1.0) -> str:
    """A filled rectangle between two ends each."""
    (left, right), (top, bottom) = sorted(x.tolist()), sorted(y.tolist())
    faint = f";fill-opacity:{opacity}" if opacity < 1.0 else ""
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
        f'style="fill:{color}{faint}"/>'
    )
