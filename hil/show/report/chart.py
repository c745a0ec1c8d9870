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
LEGEND_GAP = 0.09
"""Gap between panels below each other, with room for a panel's legend."""


class Panel(NamedTuple):
    """One pair of axes, and its place in the chart, as shares of the height from below.

    `with_x_of`: number of the panel, counted from 1, whose x axis this panel shares.
    """

    y_title: str
    x_title: str = ""
    height: tuple[float, float] = (0.0, 1.0)
    with_x_of: int | None = None
    y_axis: Mapping[str, Any] = MappingProxyType({})
    """Further settings of the y axis."""


class Plot(NamedTuple):
    """A chart with its title and caption."""

    title: str
    caption: str
    chart: Json


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
    line, named = {"color": color, "width": 2.0, "dash": dash}, dash == "solid"
    ends = [from_x, to_x], [value, value]
    return trace(panel, "scatter", name, *ends, mode="lines", line=line, showlegend=named)


def points(panel: int, name: str, x: FloatArray, y: FloatArray, color: str, symbol: str = "circle") -> Json:
    """Markers at the thinned points."""
    marker = {"color": color, "size": 6, "symbol": symbol}
    return trace(panel, "scatter", name, *thinned(x, y), mode="markers", marker=marker)


def upright(panel: int, x: float, color: str = NEUTRAL, dash: str = "dot") -> Json:
    """A vertical line through the whole height of the chart."""
    line = {"color": color, "width": 1, "dash": dash}
    ends = {"x0": x, "x1": x, "y0": 0.0, "y1": 1.0}
    return {"type": "line", "xref": axis("x", panel), "yref": "paper", "line": line, **ends}


def stacked(shares: Sequence[tuple[str, float]], x_title: str) -> list[Panel]:
    """Panels below each other, each with the title of its y axis and its share of the height; one x axis."""
    whole = sum(share for _, share in shares)
    room = (1.0 - LEGEND_GAP * (len(shares) - 1)) / whole
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
        top = bottom - LEGEND_GAP
    return panels


def chart(
    height_px: int,
    panels: Sequence[Panel],
    traces: Sequence[Json],
    shapes: Sequence[Json] = (),
    **layout: Any,
) -> Json:
    """Data and layout of a chart, with a legend above each panel; `layout`: further settings."""
    axes: Json = {}
    for number, panel in enumerate(panels, 1):
        moves = (
            {}
            if panel.with_x_of is None
            else {"matches": axis("x", panel.with_x_of), "showticklabels": False}
        )
        plain: Json = {"zeroline": False, "gridcolor": "rgba(128, 134, 143, 0.25)"}
        x = {"anchor": axis("y", number), "title": {"text": panel.x_title}, **moves}
        y = {"anchor": axis("x", number), "domain": panel.height, "title": {"text": panel.y_title}}
        axes[axis("xaxis", number)] = {**plain, **x}
        axes[axis("yaxis", number)] = {**plain, **y, **panel.y_axis}
        axes[axis("legend", number)] = {
            **{"orientation": "h", "traceorder": "normal", "xanchor": "left", "yanchor": "bottom"},
            **{"x": 0.0, "y": panel.height[1], "font": {"size": 11}},
        }
    return {
        "data": [{**one, "legend": axis("legend", int(one["yaxis"][1:] or 1))} for one in traces],
        "layout": {
            "height": height_px,
            "margin": {"l": SIDE_PX, "r": 12, "t": LEGEND_PX, "b": X_TITLE_PX},
            "font": {"family": "system-ui, sans-serif", "size": 12},
            "paper_bgcolor": "rgba(0, 0, 0, 0)",
            "plot_bgcolor": "rgba(0, 0, 0, 0)",
            "modebar": {"bgcolor": "rgba(0, 0, 0, 0)"},
            "hovermode": "closest",
            "shapes": list(shapes),
            **axes,
            **layout,
        },
    }
