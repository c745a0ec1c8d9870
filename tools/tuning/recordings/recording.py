"""The result of a tuning command as a Rerun recording: curves, and the parameters as text.

A curve's timeline is the quantity that was varied (a frequency, a threshold, a candidate's number), which the
viewer plays like time. Its steps are whole numbers, so the quantity is counted in small units.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from hil.record.state_timeline import ALARM, ESTIMATE, OTHER, TARGET, TRUTH
from hil.show.log_stream import recorded
from tools.tuning.result import Tuning

COLOURS = (TRUTH, ESTIMATE, OTHER, ALARM, TARGET)
FIGURES_SHOWN = 30


class Curve(NamedTuple):
    """Values over steps of the timeline, both of shape (n,); `dots`: points rather than a line."""

    steps: NDArray[np.int64]
    values: NDArray[np.float64]
    dots: bool = False


Views = Mapping[str, Mapping[str, Curve]]
"""For the title of each view, its curves by name."""


def curve(steps: Sequence[float], values: Sequence[float], unit: float = 1.0, dots: bool = False) -> Curve:
    """A curve whose steps are counted in `unit`s; values that are not finite are left out.

    >>> curve([0.1, 0.2, 0.3], [1.0, float("nan"), 3.0], unit=0.1).steps.tolist()
    [1, 3]
    """
    at, of = np.asarray(steps, np.float64), np.asarray(values, np.float64)
    order = np.argsort(at, kind="stable")
    at, of = at[order], of[order]
    kept = np.isfinite(of) & np.isfinite(at)
    return Curve(np.round(at[kept] / unit).astype(np.int64), of[kept], dots)


def record_tuning(path: Path, tuning: Tuning, timeline: str, views: Views) -> None:
    """Write the recording; `vibrohil view FILE` opens it."""
    names = list(views)
    plots = rrb.Grid(
        *(
            rrb.TimeSeriesView(
                origin=f"/{_entity(name)}",
                name=name,
                plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
                # The whole curve, at every position of the time cursor.
                axis_x=rrb.archetypes.TimeAxis(view_range=_whole(curves)),
                time_ranges=rrb.VisibleTimeRange(
                    timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()
                ),
            )
            for name, curves in views.items()
        ),
        grid_columns=2 if len(names) > 1 else 1,
    )
    layout = rrb.Blueprint(
        rrb.Horizontal(
            rrb.TextDocumentView(origin="/parameters", name="parameters"), plots, column_shares=[1, 2]
        ),
        rrb.TimePanel(timeline=timeline, state="collapsed"),
        collapse_panels=True,
    )
    with recorded(path, f"tune {tuning.command}", layout) as recording:
        text = rr.TextDocument(as_markdown(tuning), media_type="text/markdown")
        recording.log("parameters", text, static=True)
        for name, curves in views.items():
            for number, (label, one) in enumerate(curves.items()):
                _log_curve(recording, f"{_entity(name)}/{_entity(label)}", label, one, number, timeline)


def _log_curve(
    recording: rr.RecordingStream, entity: str, label: str, one: Curve, number: int, timeline: str
) -> None:
    colour = np.array([COLOURS[number % len(COLOURS)]], np.uint32)
    style = (
        rr.SeriesPoints(colors=colour, markers="circle", marker_sizes=4.0, names=label)
        if one.dots
        else rr.SeriesLines(colors=colour, widths=1.6, names=label)
    )
    recording.log(entity, style, static=True)
    if len(one.steps):
        steps = [rr.TimeColumn(timeline, sequence=one.steps)]
        recording.send_columns(entity, steps, [*rr.Scalars.columns(scalars=one.values)])


def _whole(curves: Mapping[str, Curve]) -> rr.TimeRange:
    """The range from the first to the last step of all curves of a view."""
    steps = np.concatenate([one.steps for one in curves.values()])
    first, last = (int(steps.min()), int(steps.max())) if len(steps) else (0, 1)
    return rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seq=first),
        end=rr.TimeRangeBoundary.absolute(seq=max(last, first + 1)),
    )


def _entity(name: str) -> str:
    """A name as part of an entity's path."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def as_markdown(tuning: Tuning) -> str:
    """Parameters, figures of merit and warnings."""
    lines = [f"# tune {tuning.command}", "", tuning.source, "", "| parameter | value | low | high | unit |"]
    lines += ["|---|---:|---:|---:|---|"]
    lines += [
        f"| {name} | {one.value:.5g} | {one.low:.5g} | {one.high:.5g} | {one.unit} |"
        for name, one in tuning.parameters.items()
    ]
    lines += ["", f"low, high: {tuning.range_is}", "", "| figure of merit | value | unit |", "|---|---:|---|"]
    lines += [
        f"| {name.replace('_', ' ')} | {one.value:.4g} | {one.unit} |"
        for name, one in list(tuning.figures_of_merit.items())[:FIGURES_SHOWN]
    ]
    lines += [f"\n**warning:** {warning}" for warning in tuning.warnings]
    return "\n".join(lines)
