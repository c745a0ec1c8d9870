"""Shared by the plots of a report: colours, style, thinned curves, inline SVG."""

import io
import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from hil.record import state_timeline
from plant_sim.arrays import FloatArray


def css(rgba: int) -> str:
    """One of the log's colours as a page writes it.

    >>> css(0x56B4E9FF)
    '#56b4e9'
    """
    return f"#{rgba >> 8:06x}"


TRUTH, ESTIMATE, TARGET, OTHER, ALARM, GOOD = map(css, state_timeline.PALETTE)
INK, FAINT = "#010203", "#040506"
"""Stand-ins for the page's own colours, which differ in the dark."""
MOST_POINTS = 2400
"""A curve has no more points than a wide screen has pixels to show them."""
LEFT_IN, RIGHT_IN, BOTTOM_IN, TOP_IN = 0.75, 0.1, 0.45, 0.1
"""Margins for an axis with its name, in inches: to have them computed takes as long again as to draw."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "vibrohil",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.alpha": 0.25,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "path.simplify_threshold": 0.5,
}


class Plot(NamedTuple):
    """A drawing with the sentence that says what it shows."""

    title: str
    caption: str
    svg: str
    half: bool = False
    """Whether two of its kind stand side by side."""


def thinned(t: FloatArray, *values: FloatArray) -> tuple[FloatArray, ...]:
    """Rows of at most `MOST_POINTS`, the extremes of the first of `values` among them; all of shape (n,)."""
    if len(t) <= MOST_POINTS:
        return (t, *values)
    edges = np.linspace(0, len(t), MOST_POINTS // 2 + 1).astype(int)
    rows: list[int] = []
    for low, high in itertools.pairwise(edges.tolist()):
        block = values[0][low:high]
        rows += sorted({low + int(np.argmin(block)), low + int(np.argmax(block))})
    return (t[rows], *(value[rows] for value in values))


@contextmanager
def canvas(width: float, height: float) -> Iterator[Figure]:
    """An empty figure in the report's style, sizes in inches at 96 pixels."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height))
        figure.subplots_adjust(
            left=LEFT_IN / width,
            right=1.0 - RIGHT_IN / width,
            bottom=BOTTOM_IN / height,
            top=1.0 - TOP_IN / height,
            hspace=0.12,
            wspace=0.3,
        )
        yield figure


def svg_of(figure: Figure) -> str:
    """The figure as an SVG element whose colours follow the page."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    return text.replace(INK, "var(--ink)").replace(FAINT, "var(--faint)").strip()
