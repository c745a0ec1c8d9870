"""The charts of a report, as data and layout that plotly.js plots in the reader's browser.

A reader can zoom into them, and they take a thirtieth of the time that rendered images would take. Traces and
axes are those of https://plotly.com/javascript/reference.
"""

import base64
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hil.record import state_timeline
from plant_sim.arrays import FloatArray

Json = dict[str, Any]


def css(rgba: int) -> str:
    """One of the log's colours in CSS notation.

    >>> css(0x56B4E9FF)
    '#56b4e9'
    """
    return f"#{rgba >> 8:06x}"


TRUTH, ESTIMATE, TARGET, OTHER, ALARM, GOOD = map(css, state_timeline.PALETTE)
NEUTRAL = "#80868f"
"""Colour of dividing lines, visible on a light and a dark background."""
MOST_POINTS = 2400
"""Largest number of points of a curve: the pixels of a wide screen."""
LEGEND_PX, X_TITLE_PX, SIDE_PX = 30, 44, 62
"""Margins above, below and on the left of a chart."""
GAP = 0.05
"""Gap between panels, as a share of the chart."""


class Panel(NamedTuple):
    """One pair of axes, and its place in the chart, as shares of width and height from the lower left.

    `with_x_of`: number of the panel, counted from 1, whose x axis this panel shares.
    """

    y_title: str
    x_title: str = ""
    width: tuple[float, float] = (0.0, 1.0)
    height: tuple[float, float] = (0.0, 1.0)
    with_x_of: int | None = None
    x_axis: Mapping[str, Any] = MappingProxyType({})
    y_axis: Mapping[str, Any] = MappingProxyType({})
    """Further settings of the axes."""


class Plot(NamedTuple):
    """A chart with its title and caption."""

    title: str
    caption: str
    chart: Json
    half: bool = False
    """Whether the chart takes half of the page's width."""


def thinned(t: FloatArray, *values: FloatArray) -> tuple[FloatArray, ...]:
    """At most `MOST_POINTS` rows, including the extremes of the first of `values`; all of shape (n,)."""
    blocks = MOST_POINTS // 2
    if len(t) <= MOST_POINTS:
        return (t, *values)
    length = -(-len(t) // blocks)
    padded = np.pad(values[0], (0, blocks * length - len(t)), mode="edge").reshape(blocks, length)
    starts = length * np.arange(blocks)
    extremes = np.concatenate([starts + padded.argmin(axis=1), starts + padded.argmax(axis=1)])
    rows = np.unique(np.minimum(extremes, len(t) - 1))
    return (t[rows], *(value[rows] for value in values))


def numbers(values: ArrayLike, kind: str = "f4") -> Json:
    """Values in Plotly's binary format, in single precision, or in double precision for `f8`."""
    data = np.asarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(data.tobytes()).decode()}


def axis(letter: str, panel: int) -> str:
    """Plotly's name of a panel's axis; panels count from 1, and the first has no number.

    >>> axis("x", 1), axis("yaxis", 2)
    ('x', 'yaxis2')
    """
    return letter if panel == 1 else f"{letter}{panel}"


def on(panel: int) -> Json:
    """The axes of a panel in a trace."""
    return {"xaxis": axis("x", panel), "yaxis": axis("y", panel)}


def trace(panel: int, kind: str, name: str, x: ArrayLike, y: ArrayLike, **settings: Any) -> Json:
    """A trace of `y` over `x` in a panel; `kind` and `settings` are Plotly's."""
    return {"type": kind, "name": name, "x": numbers(x, "f8"), "y": numbers(y), **on(panel), **settings}


def curve(
    panel: int,
    name: str,
    t: FloatArray,
    values: FloatArray,
    color: str,
    width: float = 1.2,
    dash: str = "solid",
) -> Json:
    """A line through the thinned points."""
    line = {"color": color, "width": width, "dash": dash}
    return trace(panel, "scatter", name, *thinned(t, values), mode="lines", line=line)


def level(
    panel: int, name: str, value: float, from_x: float, to_x: float, color: str, dash: str = "solid"
) -> Json:
    """A horizontal line; only a solid one has an entry in the legend."""
    line, named = {"color": color, "width": 1.2, "dash": dash}, dash == "solid"
    ends = [from_x, to_x], [value, value]
    return trace(panel, "scatter", name, *ends, mode="lines", line=line, showlegend=named)


def points(panel: int, name: str, x: FloatArray, y: FloatArray, color: str, symbol: str = "circle") -> Json:
    """Markers at the thinned points."""
    marker = {"color": color, "size": 6, "symbol": symbol}
    return trace(panel, "scatter", name, *thinned(x, y), mode="markers", marker=marker)


def columns(panel: int, name: str, edges: FloatArray, counts: ArrayLike, color: str) -> Json:
    """The columns of a histogram between `edges`, shape (n + 1,), with `counts`, shape (n,)."""
    middles, widths = 0.5 * (edges[1:] + edges[:-1]), numbers(np.diff(edges))
    return trace(panel, "bar", name, middles, counts, width=widths, marker={"color": color}, showlegend=False)


def outline(panel: int, name: str, edges: FloatArray, counts: ArrayLike, color: str, named: bool) -> Json:
    """The outline of a histogram between `edges`, shape (n + 1,), with `counts`, shape (n,)."""
    line, heights = {"color": color, "width": 1.2, "shape": "hv"}, np.append(counts, 0.0)
    return trace(panel, "scatter", name, edges, heights, mode="lines", line=line, showlegend=named)


def upright(panel: int, x: float, color: str = NEUTRAL, dash: str = "dot") -> Json:
    """A vertical line through the whole height of the chart."""
    line = {"color": color, "width": 1, "dash": dash}
    ends = {"x0": x, "x1": x, "y0": 0.0, "y1": 1.0}
    return {"type": "line", "xref": axis("x", panel), "yref": "paper", "line": line, **ends}


def band(panel: int, from_x: float, to_x: float, color: str) -> Json:
    """A shaded band through the whole height of the chart, behind all curves."""
    ends = {"x0": from_x, "x1": to_x, "y0": 0.0, "y1": 1.0}
    shade = {"fillcolor": color, "opacity": 0.15, "line": {"width": 0}, "layer": "below"}
    return {"type": "rect", "xref": axis("x", panel), "yref": "paper", **shade, **ends}


def stacked(shares: Sequence[tuple[str, float]], x_title: str) -> list[Panel]:
    """Panels below each other, each with the title of its y axis and its share of the height; one x axis."""
    whole = sum(share for _, share in shares)
    room = (1.0 - GAP * (len(shares) - 1)) / whole
    panels: list[Panel] = []
    top = 1.0
    for number, (title, share) in enumerate(shares, 1):
        bottom = max(top - room * share, 0.0)
        last = number == len(shares)
        panels.append(
            Panel(
                title, x_title if last else "", height=(bottom, top), with_x_of=None if last else len(shares)
            )
        )
        top = bottom - GAP
    return panels


def side_by_side(titles: Sequence[str], y_title: str = "") -> list[Panel]:
    """Panels of equal width, each with the title of its x axis; the first one with `y_title`."""
    step = (1.0 + 2.0 * GAP) / len(titles)
    return [
        Panel("" if place else y_title, title, width=(place * step, (place + 1) * step - 2.0 * GAP))
        for place, title in enumerate(titles)
    ]


def chart(
    height_px: int,
    panels: Sequence[Panel],
    traces: Sequence[Json],
    shapes: Sequence[Json] = (),
    **layout: Any,
) -> Json:
    """Data and layout of a chart; `layout`: further settings."""
    axes: Json = {}
    for number, panel in enumerate(panels, 1):
        moves = (
            {}
            if panel.with_x_of is None
            else {"matches": axis("x", panel.with_x_of), "showticklabels": False}
        )
        plain: Json = {"zeroline": False, "gridcolor": "rgba(128, 134, 143, 0.25)"}
        x = {"anchor": axis("y", number), "domain": panel.width, "title": {"text": panel.x_title}, **moves}
        y = {"anchor": axis("x", number), "domain": panel.height, "title": {"text": panel.y_title}}
        axes[axis("xaxis", number)] = {**plain, **x, **panel.x_axis}
        axes[axis("yaxis", number)] = {**plain, **y, **panel.y_axis}
    return {
        "data": list(traces),
        "layout": {
            "height": height_px,
            "margin": {"l": SIDE_PX, "r": 12, "t": LEGEND_PX, "b": X_TITLE_PX},
            "legend": {"orientation": "h", "traceorder": "normal", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
            "font": {"family": "system-ui, sans-serif", "size": 12},
            "paper_bgcolor": "rgba(0, 0, 0, 0)",
            "plot_bgcolor": "rgba(0, 0, 0, 0)",
            "modebar": {"bgcolor": "rgba(0, 0, 0, 0)"},
            "hovermode": "closest",
            "bargap": 0,
            "shapes": list(shapes),
            **axes,
            **layout,
        },
    }
