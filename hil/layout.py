"""The layout that comes with a log: what one wants to see first, legible at 1280 × 800.

Plots pick fields out of the traces' records, so names, units and colours of the series live here.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from hil.lanes import ALARM, ESTIMATE, GOOD, OTHER, TARGET, TRUTH

LARGEST_NIS = 9.0
"""Of an honest filter 0.3 % lie beyond; a contact not yet found goes into the thousands."""

DARK_TRUTH, DARK_ESTIMATE = 0x2E6DA8FF, 0xA8691EFF


class Moments(NamedTuple):
    """What to open on, in simulated seconds: the run-up, a few drive periods close up; the fastest impact,
    the innovation's usual σ in flight, whether a check failed, and whether somebody wears the module.
    """

    run_up_s: tuple[float, float]
    detail_s: tuple[float, float]
    largest_v_m_s: float
    innovation_std_m_s2: float
    marked: bool
    worn: bool


class Mark(NamedTuple):
    """A moment worth finding again: that of a failed check."""

    t_s: float
    text: str


class Line(NamedTuple):
    """A field of a trace's or a frame's records drawn as a line; `variance` is that of its σ², a band."""

    entity: str
    field: str
    name: str
    unit: str
    color: int
    variance: str | None = None


class Dots(NamedTuple):
    """Points without a line: a field of the records in `entity`, or its scalars where no field is named."""

    entity: str
    field: str | None
    name: str
    color: int
    marker: Literal["circle", "cross", "diamond"]


class Whole(NamedTuple):
    """An entity that says itself how it is drawn."""

    entity: str


def mapped(entity: str, target: str, field: str | None) -> list[VisualizerComponentMapping]:
    """Where a visualizer's slot takes its numbers from."""
    if field is None:
        return []
    source = ComponentSourceKind.SourceComponent
    component = "frame:record" if entity.startswith("/can/") else "trace:record"
    return [VisualizerComponentMapping(target, source, source_component=component, selector=f".{field}")]


def visualizer(series: Line | Dots) -> Any:
    """How one series is drawn."""
    color = np.array([series.color], np.uint32)
    if isinstance(series, Line):
        line = rr.Measurements.from_fields(names=[series.name], units=[series.unit], colors=color)
        values = mapped(series.entity, "Measurements:values", series.field)
        variances = mapped(series.entity, "Measurements:variances", series.variance)
        return line.visualizer(mappings=values + variances)
    dots = rr.SeriesPoints.from_fields(
        names=[series.name], colors=color, markers=[series.marker], marker_sizes=[3.5]
    )
    return dots.visualizer(mappings=mapped(series.entity, "Scalars:scalars", series.field))


def plot(
    name: str,
    *series: Line | Dots | Whole,
    span_s: tuple[float, float] | None = None,
    range_y: tuple[float, float] | None = None,
    legend: rrb.Corner2D | None = rrb.Corner2D.LeftTop,
) -> rrb.TimeSeriesView:
    """A plot of `series`, opened on `span_s` or on all there is, and on `range_y` or what is drawn."""
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
    """A fixed stretch of simulated time."""
    start, end = (rr.TimeRangeBoundary.absolute(seconds=edge_s) for edge_s in span_s)
    return rr.TimeRange(start=start, end=end)


POSITION = (
    Line("/plant", "x_m", "true position", "m", TRUTH),
    Line("/firmware", "state.estimator.x_m", "estimate ± σ", "m", ESTIMATE, "state.estimator.p_xx"),
    Whole("/stop"),
    Dots("/impacts/touch_down", None, "touch-down", ALARM, "circle"),
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
    Line("/firmware", "outputs.torque_n_m", "asked for", "N m", ESTIMATE),
)
IMPACTS = (
    Dots("/impacts/truth", "v_m_s", "true v⁻ [m/s]", TRUTH, "circle"),
    Dots("/impacts/detected", None, "reported v⁻ [m/s]", ESTIMATE, "cross"),
)


def lanes(name: str, *states: str) -> rrb.StateTimelineView:
    """State lanes, over the whole run."""
    return rrb.StateTimelineView(
        origin="/states", contents=[f"/states/{state}" for state in states], name=name
    )


def texts(name: str, entity: str) -> rrb.TextLogView:
    """What happened, as text."""
    columns = rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(origin=entity, name=name, columns=columns)


def module() -> rrb.Spatial2DView:
    """The moving picture at the time cursor."""
    bounds = rrb.VisualBounds2D(x_range=[-140.0, 225.0], y_range=[-50.0, 50.0])
    return rrb.Spatial2DView(origin="/module", name="Module (ghost: estimate)", visual_bounds=bounds)


def shares(kind: Any, *parts: Any, by: Sequence[float], name: str | None = None) -> Any:
    """A row or a column whose parts take the given shares."""
    key = "row_shares" if kind is rrb.Vertical else "column_shares"
    return kind(*parts, name=name, **{key: list(by)})


def overview(
    detail_s: tuple[float, float] | None, speeds_m_s: tuple[float, float] | None, marked: bool
) -> Any:
    """What the run was, at one glance."""
    return shares(
        rrb.Vertical,
        lanes("Modes and regimes", "mode", "regime", "checks"),
        plot("Striker, close up [m]", *POSITION, span_s=detail_s, legend=rrb.Corner2D.LeftBottom),
        rrb.Horizontal(
            plot("Impacts", *IMPACTS, range_y=speeds_m_s, legend=rrb.Corner2D.LeftBottom),
            plot("Crank speed [rad/s]", *SPEED, legend=None),
            plot("Torque [N m]", *TORQUE, legend=None),
        ),
        shares(rrb.Horizontal, module(), texts("Events", "/events"), by=(3, 2)),
        by=(6 if marked else 5, 7, 5, 5),
        name="Overview",
    )


def start_up(run_up_s: tuple[float, float] | None, speeds_m_s: tuple[float, float] | None) -> Any:
    """How the striker got onto its orbit."""
    return shares(
        rrb.Vertical,
        plot("Striker [m]", *POSITION, span_s=run_up_s, legend=rrb.Corner2D.LeftBottom),
        plot("Impacts", *IMPACTS, span_s=run_up_s, range_y=speeds_m_s),
        plot("Crank speed [rad/s]", *SPEED, span_s=run_up_s),
        plot("Torque [N m]", *TORQUE, span_s=run_up_s),
        by=(4, 2, 2, 2),
        name="Start-up",
    )


def estimator(detail_s: tuple[float, float] | None, innovations_m_s2: tuple[float, float] | None) -> Any:
    """Whether the filter is right and honest about it."""
    innovation = "state.estimator.innovation_m_s2"
    deviation = "state.estimator.innovation_std_m_s2"
    return rrb.Vertical(
        plot("Velocity, close up [m/s]", *VELOCITY, span_s=detail_s),
        plot(
            "Acceleration, close up [m/s²]",
            Line("/can/Accelerometer", "striker_high_m_s2", "high range", "m/s²", OTHER),
            Line("/can/Accelerometer", "striker_low_m_s2", "low range", "m/s²", ESTIMATE),
            Line("/can/Accelerometer", "housing_m_s2", "housing", "m/s²", TARGET),
            Line("/plant", "accel_m_s2", "true", "m/s²", TRUTH),
            span_s=detail_s,
            legend=rrb.Corner2D.LeftBottom,
        ),
        rrb.Horizontal(
            plot(
                "Innovation in flight, close up [m/s²]",
                Line("/firmware", innovation, "innovation", "m/s²", ESTIMATE),
                Line("/firmware", deviation, "its σ", "m/s²", TARGET),
                span_s=detail_s,
                range_y=innovations_m_s2,
            ),
            plot(
                "NIS (mean of an honest filter: 1)",
                Line("/firmware", "state.estimator.nis", "NIS", "", OTHER),
                range_y=(0.0, LARGEST_NIS),
            ),
            plot(
                "Accelerometer bias [m/s²]",
                Line(
                    "/firmware",
                    "state.estimator.bias_m_s2",
                    "bias ± σ",
                    "m/s²",
                    ESTIMATE,
                    "state.estimator.p_bb",
                ),
                legend=rrb.Corner2D.RightBottom,
            ),
        ),
        name="Estimator",
    )


def impacts(detail_s: tuple[float, float] | None, speeds_m_s: tuple[float, float] | None, worn: bool) -> Any:
    """The impacts: how fast, how hard, what the wearer feels of them, and what they cost."""
    forces = [Line("/plant", "stop_force_n", "on the stop", "N", ALARM)]
    if worn:
        forces.append(Line("/plant", "felt_force_n", "felt by the wearer", "N", OTHER))
    return rrb.Vertical(
        rrb.Horizontal(
            plot("Approach speed", *IMPACTS, range_y=speeds_m_s, legend=rrb.Corner2D.LeftBottom),
            plot(
                "Impulse",
                Dots("/impacts/truth", "impulse_n_s", "impulse [N s]", OTHER, "diamond"),
                legend=rrb.Corner2D.RightBottom,
            ),
            plot(
                "Peak force",
                Dots("/impacts/truth", "peak_force_n", "peak force [N]", ALARM, "circle"),
                legend=rrb.Corner2D.RightBottom,
            ),
        ),
        plot(
            "Force, close up [N]",
            *forces,
            span_s=detail_s,
        ),
        plot(
            "Energy [J]",
            Line("/plant", "drive_work_j", "drive work", "J", TRUTH),
            Line("/plant", "friction_j", "friction", "J", ESTIMATE),
            Line("/plant", "impact_loss_j", "impacts", "J", ALARM),
            Line("/plant", "stored_j", "stored", "J", OTHER),
        ),
        name="Impacts",
    )


def gait(detail_s: tuple[float, float] | None) -> Any:
    """The wearer's cycle, true and estimated, and where in it the pulses come."""
    return shares(
        rrb.Vertical,
        lanes("The leg: true, estimated", "leg", "leg_estimated"),
        plot(
            "Gait cycle: phase and pulses",
            Line("/plant", "gait.phase", "true", "", TRUTH),
            Line("/firmware", "state.gait.phase", "estimate", "", ESTIMATE),
            Whole("/gait/window/from"),
            Whole("/gait/window/to"),
            Dots("/gait/inside", None, "pulse in the window", GOOD, "circle"),
            Dots("/gait/outside", None, "pulse outside", ALARM, "cross"),
            span_s=detail_s,
            range_y=(0.0, 1.0),
            legend=rrb.Corner2D.LeftBottom,
        ),
        rrb.Horizontal(
            plot(
                "Pulses over the cycle, whole run",
                Whole("/gait/window/from"),
                Whole("/gait/window/to"),
                Dots("/gait/inside", None, "in the window", GOOD, "circle"),
                Dots("/gait/outside", None, "outside", ALARM, "cross"),
                range_y=(0.0, 1.0),
            ),
            plot(
                "Strides a second, crank turns a stride, confidence",
                Line("/plant", "gait.stride_hz", "true strides a second", "Hz", TRUTH),
                Line("/firmware", "state.lock.harmonic", "turns a stride", "", OTHER),
                Line("/firmware", "state.gait.confidence", "confidence", "", ESTIMATE),
            ),
        ),
        rrb.Horizontal(
            plot(
                "Felt by the wearer, close up [N]",
                Line("/plant", "felt_force_n", "felt", "N", OTHER),
                span_s=detail_s,
                legend=None,
            ),
            plot(
                "Push-off: the ankle's moment, close up [N m/kg]",
                Line("/plant", "gait.ankle_n_m_kg", "true", "N m/kg", TRUTH),
                span_s=detail_s,
                legend=None,
            ),
            plot(
                "Shank's rate, close up [rad/s]",
                Line("/can/GaitSensors", "shank_rate_rad_s", "sensed", "rad/s", ESTIMATE),
                Line("/plant", "gait.shank_rad_s", "true", "rad/s", TRUTH),
                span_s=detail_s,
                legend=None,
            ),
            plot(
                "Along the striker's axis, close up [m/s²]",
                Line("/plant", "gait.axis_m_s2", "a_b", "m/s²", TRUTH),
                span_s=detail_s,
                legend=None,
            ),
        ),
        by=(4, 7, 5, 5),
        name="Gait",
    )


def bus_and_timing() -> Any:
    """Whether the clockwork ran."""
    return rrb.Vertical(
        rrb.Horizontal(
            plot(
                "Firmware loop [µs]",
                Line("/firmware", "wake_latency_us", "wake-up latency", "µs", DARK_ESTIMATE),
                Line("/firmware", "work_us", "work", "µs", ESTIMATE),
            ),
            plot(
                "Plant loop [µs]",
                Line("/plant", "wake_latency_us", "wake-up latency", "µs", DARK_TRUTH),
                Line("/plant", "work_us", "work", "µs", TRUTH),
            ),
        ),
        rrb.Horizontal(
            plot(
                "Ticks skipped so far",
                Line("/firmware", "overruns", "firmware", "", ESTIMATE),
                Line("/plant", "overruns", "plant", "", TRUTH),
            ),
            plot("Bus load (of 1 Mbit/s)", Whole("/can/load"), range_y=(0.0, 1.0)),
        ),
        rrb.Horizontal(
            lanes("Drive, faults, limits", "axis", "fault", "limit", "motion"),
            texts("Frames refused", "/can/rejected"),
        ),
        name="Bus and timing",
    )


def about() -> Any:
    """The run in words: scenario, set-up and outcome."""
    return rrb.Horizontal(
        rrb.TextDocumentView(origin="/about/scenario", name="Scenario"),
        rrb.TextDocumentView(origin="/about/run", name="Run"),
        rrb.TextDocumentView(origin="/about/outcome", name="Outcome"),
        name="About",
    )


def layout(moments: Moments | None, walked: bool = False) -> rrb.Blueprint:
    """The tabs of a run's log, opened on `moments`; without them, as while recording, on all there is.

    `walked`: somebody walks with the module.
    """
    detail_s = moments.detail_s if moments else None
    run_up_s = moments.run_up_s if moments else None
    speeds_m_s = (0.0, 1.15 * moments.largest_v_m_s) if moments else None
    widest_m_s2 = 5.0 * moments.innovation_std_m_s2 if moments else 0.0
    return rrb.Blueprint(
        rrb.Tabs(
            overview(detail_s, speeds_m_s, marked=moments is not None and moments.marked),
            start_up(run_up_s, speeds_m_s),
            estimator(detail_s, (-widest_m_s2, widest_m_s2) if moments else None),
            impacts(detail_s, speeds_m_s, worn=moments is not None and moments.worn),
            *([gait(detail_s)] if walked else []),
            bus_and_timing(),
            about(),
        ),
        rrb.TimePanel(
            timeline="sim_time", state="collapsed", play_state="playing" if moments else "following"
        ),
        collapse_panels=True,
    )


def both(name: str, entity: str, field: str, unit: str, **options: Any) -> rrb.TimeSeriesView:
    """One field of two runs in one plot."""
    return plot(
        name,
        Line(f"/a{entity}", field, "a", unit, TRUTH),
        Line(f"/b{entity}", field, "b", unit, ESTIMATE),
        **options,
    )


def overlay(difference_s: float | None) -> rrb.Blueprint:
    """The layout of two runs in one recording, close up on their first difference."""
    close_up_s = None if difference_s is None else (max(difference_s - 0.5, 0.0), difference_s + 2.5)
    sides = [
        rrb.StateTimelineView(
            origin=f"/{side}/states",
            contents=[f"/{side}/states/mode", f"/{side}/states/regime"],
            name=f"Run {side}",
        )
        for side in ("a", "b")
    ]
    mark = rrb.StateTimelineView(origin="/difference", contents=["/difference"], name="First difference")
    position, estimate = "x_m", "state.estimator.x_m"
    tabs = rrb.Tabs(
        rrb.Vertical(
            rrb.Horizontal(*sides, mark),
            both("True position, close up [m]", "/plant", position, "m", span_s=close_up_s),
            rrb.Horizontal(
                both("True position [m]", "/plant", position, "m"),
                both("Crank speed [rad/s]", "/plant", "omega_rad_s", "rad/s"),
            ),
            rrb.Horizontal(
                plot(
                    "Impacts, v⁻ [m/s]",
                    Dots("/a/impacts/truth", "v_m_s", "a", TRUTH, "circle"),
                    Dots("/b/impacts/truth", "v_m_s", "b", ESTIMATE, "cross"),
                    legend=rrb.Corner2D.LeftBottom,
                ),
                both("Torque asked for [N m]", "/firmware", "outputs.torque_n_m", "N m"),
            ),
            name="Side by side",
        ),
        rrb.Vertical(
            both("Estimated position, close up [m]", "/firmware", estimate, "m", span_s=close_up_s),
            both("Accelerometer, close up [m/s²]", "/plant", "striker_high_m_s2", "m/s²", span_s=close_up_s),
            both("NIS", "/firmware", "state.estimator.nis", ""),
            name="Estimator",
        ),
    )
    return rrb.Blueprint(
        tabs, rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="paused"), collapse_panels=True
    )
