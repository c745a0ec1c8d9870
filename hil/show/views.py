"""The views of the layout: plots, state timelines, texts, the animation."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, TimelineColumn, VisualizerComponentMapping

from hil.record.state_timeline import ESTIMATE, GOOD, TARGET, TRUTH
from hil.show.legible.extents import Extents


class Line(NamedTuple):
    """A field of a trace's records as a line; `variance`: field of its σ², drawn as a band."""

    entity: str
    field: str
    name: str
    unit: str
    color: int
    variance: str | None = None


class Dots(NamedTuple):
    """Points without a line: a field of the records in `entity`, or its scalars if `field` is None."""

    entity: str
    field: str | None
    name: str
    color: int
    marker: Literal["circle", "cross", "diamond"]


class Whole(NamedTuple):
    """An entity that is drawn in its own logged style."""

    entity: str


def map_field(target: str, field: str | None) -> list[VisualizerComponentMapping]:
    """Mapping of a field to the component `target` of a visualizer."""
    if field is None:
        return []
    source = ComponentSourceKind.SourceComponent
    return [VisualizerComponentMapping(target, source, source_component="trace:record", selector=f".{field}")]


def visualizer(series: Line | Dots) -> Any:
    """The style of one series."""
    color = np.array([series.color], np.uint32)
    if isinstance(series, Line):
        line = rr.Measurements.from_fields(names=[series.name], units=[series.unit], colors=color)
        values = map_field("Measurements:values", series.field)
        variances = map_field("Measurements:variances", series.variance)
        return line.visualizer(mappings=values + variances)
    dots = rr.SeriesPoints.from_fields(
        names=[series.name], colors=color, markers=[series.marker], marker_sizes=[3.5]
    )
    return dots.visualizer(mappings=map_field("Scalars:scalars", series.field))


def name_of(series: Line | Dots | Whole) -> str:
    """Name of a series among the `Extents`."""
    field = None if isinstance(series, Whole) else series.field
    return series.entity if field is None else f"{series.entity}.{field}"


def plot(
    name: str,
    *series: Line | Dots | Whole,
    span_s: tuple[float, float] | None = None,
    range_y: tuple[float, float] | None = None,
    legend: rrb.Corner2D | None = rrb.Corner2D.LeftTop,
    extents: Extents | None = None,
) -> rrb.TimeSeriesView:
    """A plot of `series`, initially over `span_s` (None: all times) and `range_y`.

    Without `range_y` it has the rounded range of its values in `extents`, or Rerun's own without these.
    """
    if range_y is None and extents is not None:
        range_y = extents.of(map(name_of, series))
    drawn: dict[str | rr.datatypes.EntityPath, list[Any]] = {}
    for item in series:
        if not isinstance(item, Whole):
            drawn.setdefault(item.entity, []).append(visualizer(item))
    return rrb.TimeSeriesView(
        name=name,
        contents=sorted({item.entity for item in series}),
        overrides=drawn,
        plot_legend=rrb.PlotLegend(legend, visible=legend is not None),
        axis_y=None if range_y is None else rrb.ScalarAxis(range=range_y),
        axis_x=None if span_s is None else rrb.archetypes.TimeAxis(view_range=span(span_s)),
    )


def span(span_s: tuple[float, float]) -> rr.TimeRange:
    """A fixed interval of simulated time."""
    start, end = (rr.TimeRangeBoundary.absolute(seconds=edge_s) for edge_s in span_s)
    return rr.TimeRange(start=start, end=end)


POSITION = (
    Line("/plant", "x_m", "true position", "m", TRUTH),
    Line("/firmware", "state.estimator.x_m", "estimate ± σ", "m", ESTIMATE, "state.estimator.p_xx"),
    Whole("/stop"),
    Dots("/impacts/touch_down", None, "touch-down", GOOD, "circle"),
)


VELOCITY = (
    Line("/plant", "v_m_s", "true velocity", "m/s", TRUTH),
    Line("/firmware", "state.estimator.v_m_s", "estimate ± σ", "m/s", ESTIMATE, "state.estimator.p_vv"),
)


SPEED = (
    Line("/plant", "omega_rad_s", "true", "rad/s", TRUTH),
    Line("/firmware", "outputs.target_omega_rad_s", "target", "rad/s", TARGET),
    Line("/firmware", "state.crank.omega_rad_s", "estimate", "rad/s", ESTIMATE),
)


TORQUE = (
    Line("/plant", "motor_torque_n_m", "motor", "N m", TRUTH),
    Line("/firmware", "outputs.torque_n_m", "requested", "N m", ESTIMATE),
)


IMPACTS = (
    Dots("/impacts/truth", "v_m_s", "true v⁻ [m/s]", TRUTH, "circle"),
    Dots("/impacts/detected", None, "reported v⁻ [m/s]", ESTIMATE, "cross"),
)


def state_timelines(name: str, *states: str, root: str) -> rrb.StateTimelineView:
    """State timelines over the whole run, below `/states` during it and below `/timeline` afterwards."""
    return rrb.StateTimelineView(
        origin=f"/{root}", contents=[f"/{root}/{state}" for state in states], name=name
    )


def texts(name: str, entity: str) -> rrb.TextLogView:
    """A list of events; each text begins with its time, since the viewer would truncate a time column."""
    hidden = [TimelineColumn(name, visible=False) for name in ("sim_time", "wall_time")]
    columns = rrb.TextLogColumns(timeline_columns=hidden, text_log_columns=["body", "loglevel"])
    return rrb.TextLogView(origin=entity, name=name, columns=columns)


def module() -> rrb.Spatial2DView:
    """The animation of the module at the time cursor."""
    bounds = rrb.VisualBounds2D(x_range=[-140.0, 225.0], y_range=[-50.0, 50.0])
    return rrb.Spatial2DView(origin="/module", name="Module (ghost: estimate)", visual_bounds=bounds)


def shares(kind: Any, *parts: Any, by: Sequence[float], name: str | None = None) -> Any:
    """A row or a column whose parts take the given shares."""
    key = "row_shares" if kind is rrb.Vertical else "column_shares"
    return kind(*parts, name=name, **{key: list(by)})
