"""The layout stored with a log: its tabs and plots, legible at 1280 × 800.

Plots select fields of the traces' records, so names, units and colours of the series are defined here.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import rerun.blueprint as rrb

from hil.bus.model.fault_confinement import RECORDED
from hil.record.state_timeline import ALARM, ESTIMATE, GOOD, OTHER, TARGET, TRUTH
from hil.show.legible.extents import Extents
from hil.show.legible.limits import APPROACH_LIMITS, FORCE_LIMITS
from hil.show.views import (
    IMPACTS,
    POSITION,
    SPEED,
    TORQUE,
    VELOCITY,
    Dots,
    Line,
    Whole,
    module,
    plot,
    shares,
    state_timelines,
    texts,
)

LARGEST_NIS = 9.0
"""Upper end of the NIS plot: 0.3 % of a consistent filter's values exceed it, and an undetected contact
reaches thousands."""

DARK_TRUTH, DARK_ESTIMATE = 0x2E6DA8FF, 0xA8691EFF


class Highlights(NamedTuple):
    """The initial view: run-up and close-up in simulated seconds."""

    run_up_s: tuple[float, float]
    detail_s: tuple[float, float]


class Contents(NamedTuple):
    """Optional contents of a run's log, which determine the panels of its layout."""

    worn: bool = False
    walked: bool = False
    impacts: bool = True
    judged: bool = False
    failed: bool = False
    injected: bool = False
    measured: bool = True
    """Whether the loops' times are measured, which they are not in lockstep."""
    bus_errors: bool = False
    refused: bool = True
    """Whether frames could not be decoded."""
    held: bool = False
    """Whether time was held."""
    imported: bool = False
    """Whether the log is of a real bench, with neither truth nor the firmware's internal signals."""
    limited: tuple[str, ...] = ()
    """The entities with limits of checks."""


class Drawing(NamedTuple):
    """How plots and state timelines of one log are made: `plot` and `state_timelines`, without their ends."""

    plot: Callable[..., rrb.TimeSeriesView]
    states: Callable[..., rrb.StateTimelineView]


class Mark(NamedTuple):
    """A marked time: that of a failed check."""

    t_s: float
    text: str


def limits(contents: Contents, entity: str) -> list[Whole]:
    """The limits in one plot, if there are some."""
    return [Whole(entity)] * (entity in contents.limited)


APPROACH_SPEED, PEAK_FORCE = "Approach speed v⁻ [m/s]", "Peak force [N]"
"""Titles of plots that stand in several tabs, or that a run without impacts does not have."""


def approach_speeds(draw: Drawing, contents: Contents, **options: Any) -> rrb.TimeSeriesView:
    """The approach speeds of all impacts, with the limits of checks on them."""
    lines = limits(contents, APPROACH_LIMITS)
    name = f"{APPROACH_SPEED}, limits red" if lines else APPROACH_SPEED
    return draw.plot(name, *IMPACTS, *lines, **{"legend": rrb.Corner2D.RightBottom} | options)


def overview(draw: Drawing, detail_s: tuple[float, float] | None, contents: Contents) -> Any:
    """The overview of the run: the verdict and its explanation."""
    more = [*(["injected"] if contents.injected else []), *(["checks"] if contents.failed else [])]
    verdict = [rrb.TextDocumentView(origin="/about/verdict", name="Verdict")] * contents.judged
    return shares(
        rrb.Vertical,
        draw.states("Modes and regimes", "mode", "regime", *more),
        draw.plot("Striker, close up [m]", *POSITION, span_s=detail_s, legend=rrb.Corner2D.LeftBottom),
        rrb.Horizontal(
            *([approach_speeds(draw, contents, legend=None)] if contents.impacts else []),
            draw.plot("Crank speed [rad/s], target grey", *SPEED, legend=None),
            draw.plot("Torque [N m], requested orange", *TORQUE, legend=None),
        ),
        rrb.Horizontal(module(), *verdict, texts("Events", "/events")),
        by=(5 + len(more), 7, 5, 6),
        name="Overview",
    )


def start_up(draw: Drawing, run_up_s: tuple[float, float] | None, contents: Contents) -> Any:
    """The start-up of the striker to its orbit."""
    impact_plots = [approach_speeds(draw, contents, span_s=run_up_s)] * contents.impacts
    return shares(
        rrb.Vertical,
        draw.plot("Striker [m]", *POSITION, span_s=run_up_s, legend=rrb.Corner2D.LeftBottom),
        *impact_plots,
        draw.plot("Crank speed [rad/s]", *SPEED, span_s=run_up_s),
        draw.plot("Torque [N m]", *TORQUE, span_s=run_up_s),
        by=(4, *[2] * (2 + len(impact_plots))),
        name="Start-up",
    )


def estimator(draw: Drawing, detail_s: tuple[float, float] | None, contents: Contents) -> Any:
    """The estimator: its errors and the consistency of its covariance."""
    innovation = "state.estimator.innovation_m_s2"
    deviation = "state.estimator.innovation_std_m_s2"

    def error(name: str, field: str, unit: str) -> rrb.TimeSeriesView:
        line = Line("/estimate_error", field, "estimate − truth", unit, ESTIMATE)
        return draw.plot(f"Error of the {name}, whole run [{unit}]", line)

    velocity = draw.plot("Velocity, close up [m/s]", *VELOCITY, span_s=detail_s)
    if contents.imported:
        return rrb.Vertical(velocity, acceleration(draw, detail_s), name="Estimator")
    return rrb.Vertical(
        velocity,
        rrb.Horizontal(error("position", "x_m", "m"), error("velocity", "v_m_s", "m/s")),
        acceleration(draw, detail_s),
        rrb.Horizontal(
            draw.plot(
                "Innovation in flight, close up [m/s²]",
                Line("/firmware", innovation, "innovation", "m/s²", ESTIMATE),
                Line("/firmware", deviation, "its σ", "m/s²", TARGET),
                span_s=detail_s,
            ),
            draw.plot(
                "NIS; its mean is 1 if the uncertainty is right",
                Line("/firmware", "state.estimator.nis", "NIS", "", OTHER),
                Whole("/nis_expected"),
                range_y=(0.0, LARGEST_NIS),
                legend=None,
            ),
            draw.plot(
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


def acceleration(draw: Drawing, detail_s: tuple[float, float] | None) -> rrb.TimeSeriesView:
    """The accelerometers' readings, with the true acceleration."""
    return draw.plot(
        "Acceleration, close up [m/s²]",
        Line("/firmware", "inputs.accelerometer.high_m_s2", "high range", "m/s²", OTHER),
        Line("/firmware", "inputs.accelerometer.low_m_s2", "low range", "m/s²", ESTIMATE),
        Line("/firmware", "inputs.accelerometer.housing_m_s2", "housing", "m/s²", TARGET),
        Line("/plant", "accel_m_s2", "true", "m/s²", TRUTH),
        span_s=detail_s,
        legend=rrb.Corner2D.LeftBottom,
    )


def impacts(draw: Drawing, detail_s: tuple[float, float] | None, contents: Contents) -> Any:
    """The impacts: approach speed, impulse and peak force, felt force, and energy."""
    forces: list[Line | Whole] = [Line("/plant", "stop_force_n", "on the stop", "N", TRUTH)]
    if contents.worn:
        forces += [Line("/plant", "felt_force_n", "felt by the wearer", "N", OTHER)]
    impulse = draw.plot(
        "Impulse [N s]",
        Dots("/impacts/truth", "impulse_n_s", "true impulse [N s]", TRUTH, "diamond"),
        Dots("/impacts/detected_impulse", None, "reported impulse [N s]", ESTIMATE, "cross"),
        legend=rrb.Corner2D.RightBottom,
    )
    if contents.imported:
        return rrb.Vertical(
            approach_speeds(draw, contents), impulse, acceleration(draw, detail_s), name="Impacts"
        )
    return rrb.Vertical(
        rrb.Horizontal(
            approach_speeds(draw, contents),
            impulse,
            draw.plot(
                PEAK_FORCE,
                Dots("/impacts/truth", "peak_force_n", "peak force [N]", TRUTH, "circle"),
                *limits(contents, FORCE_LIMITS),
                legend=rrb.Corner2D.RightBottom,
            ),
        ),
        draw.plot("Force, close up [N]", *forces, span_s=detail_s),
        draw.plot(
            "Energy [J]",
            Line("/plant", "drive_work_j", "drive work", "J", TRUTH),
            Line("/plant", "friction_j", "friction", "J", TARGET),
            Line("/plant", "impact_loss_j", "impacts", "J", GOOD),
            Line("/plant", "stored_j", "stored", "J", OTHER),
        ),
        name="Impacts",
    )


OUTSIDE = "another turn's pulse"
"""Legend of pulses outside of the window: a stride has several crank turns with an impact each, and only one
of them belongs to the window."""


def gait(draw: Drawing, detail_s: tuple[float, float] | None) -> Any:
    """The wearer's gait cycle, true and estimated, and the phases of the pulses."""

    def close_up(name: str, *lines: Line) -> rrb.TimeSeriesView:
        return draw.plot(f"{name}, close up [{lines[0].unit}]", *lines, span_s=detail_s, legend=None)

    return shares(
        rrb.Vertical,
        draw.states("The leg: true, estimated", "leg", "leg_estimated"),
        draw.plot(
            "Gait cycle: phase and pulses",
            Line("/plant", "gait.phase", "true", "", TRUTH),
            Line("/firmware", "state.gait.phase", "estimate", "", ESTIMATE),
            Whole("/gait/window/from"),
            Whole("/gait/window/to"),
            Dots("/gait/inside", None, "pulse in the window", GOOD, "circle"),
            Dots("/gait/outside", None, OUTSIDE, ALARM, "cross"),
            span_s=detail_s,
            range_y=(0.0, 1.0),
            legend=rrb.Corner2D.LeftBottom,
        ),
        rrb.Horizontal(
            draw.plot(
                "Pulses over the cycle, whole run",
                Whole("/gait/window/from"),
                Whole("/gait/window/to"),
                Dots("/gait/inside", None, "in the window", GOOD, "circle"),
                Dots("/gait/outside", None, OUTSIDE, ALARM, "cross"),
                range_y=(0.0, 1.0),
                legend=None,
            ),
            draw.plot(
                "Strides a second, crank turns a stride, confidence",
                Line("/plant", "gait.stride_hz", "true strides a second", "Hz", TRUTH),
                Line("/firmware", "state.gait_lock.harmonic", "turns a stride", "", OTHER),
                Line("/firmware", "state.gait.confidence", "confidence", "", ESTIMATE),
            ),
        ),
        rrb.Horizontal(
            close_up("Felt by the wearer", Line("/plant", "felt_force_n", "felt", "N", OTHER)),
            close_up(
                "Push-off: the ankle's moment",
                Line("/plant", "gait.ankle_n_m_kg", "true", "N m/kg", TRUTH),
            ),
            close_up(
                "Shank's rate",
                Line("/firmware", "inputs.gait.shank_rate_rad_s", "sensed", "rad/s", ESTIMATE),
                Line("/plant", "gait.shank_rad_s", "true", "rad/s", TRUTH),
            ),
            close_up("Along the striker's axis", Line("/plant", "gait.axis_m_s2", "a_b", "m/s²", TRUTH)),
        ),
        by=(4, 7, 5, 5),
        name="Gait",
    )


def bus_and_timing(draw: Drawing, contents: Contents) -> Any:
    """The loops' timing, the bus load, and the states of the drive."""
    loops = (
        rrb.Horizontal(
            draw.plot(
                "Firmware loop [µs]",
                Line("/firmware", "wake_latency_us", "wake-up latency", "µs", DARK_ESTIMATE),
                Line("/firmware", "work_us", "work", "µs", ESTIMATE),
            ),
            draw.plot(
                "Plant loop [µs]",
                Line("/plant", "wake_latency_us", "wake-up latency", "µs", DARK_TRUTH),
                Line("/plant", "work_us", "work", "µs", TRUTH),
            ),
        ),
    )
    skipped = draw.plot(
        "Ticks skipped so far",
        Line("/firmware", "overruns", "firmware", "", ESTIMATE),
        Line("/plant", "overruns", "plant", "", TRUTH),
    )
    load = draw.plot("Bus load (of 1 Mbit/s)", Whole("/can/load"), range_y=(0.0, 1.0), legend=None)
    return rrb.Vertical(
        *(loops if contents.measured else ()),
        rrb.Horizontal(*([skipped] if contents.measured else []), load),
        *([bus_errors(draw)] if contents.bus_errors else []),
        rrb.Horizontal(
            draw.states("Drive, faults, limits", "axis", "fault", "limit", "motion"),
            *([texts("Frames refused", "/can/rejected")] if contents.refused else []),
        ),
        *([texts("Time held", "/held")] if contents.held else []),
        name="Bus and timing",
    )


def bus_errors(draw: Drawing) -> Any:
    """Destroyed transmissions, and the error counters and error states of the nodes' controllers."""
    nodes = tuple(zip(RECORDED, (TRUTH, ESTIMATE, OTHER), strict=True))
    return rrb.Horizontal(
        draw.plot(
            "Transmissions destroyed and frames not sent so far",
            Line("/bus_errors", "destroyed", "destroyed", "", ALARM),
            Line("/bus_errors", "unsent", "not sent", "", OTHER),
        ),
        draw.plot(
            "Error counters",
            *(Line("/bus_errors", f"{node}.transmit", f"{node}, sent", "", color) for node, color in nodes),
            *(Line("/bus_errors", f"{node}.receive", f"{node}, received", "", TARGET) for node, _ in nodes),
        ),
        draw.states("Error states", *(f"bus_{node}" for node, _ in nodes)),
    )


def about() -> Any:
    """Texts on the run: scenario, set-up and outcome."""
    return rrb.Horizontal(
        rrb.TextDocumentView(origin="/about/scenario", name="Scenario"),
        rrb.TextDocumentView(origin="/about/run", name="Run"),
        rrb.TextDocumentView(origin="/about/outcome", name="Outcome"),
        name="About",
    )


def layout(
    highlights: Highlights | None, contents: Contents, extents: Extents | None = None
) -> rrb.Blueprint:
    """The tabs of a run's log, opened on `highlights`; without them, as during a recording, on the whole run.

    After a failed check the cursor loops through its close-up. `extents`: the ranges of a finished run.
    """
    root = "states" if highlights is None else "timeline"
    draw = Drawing(partial(plot, extents=extents), partial(state_timelines, root=root))
    detail_s = highlights.detail_s if highlights else None
    run_up_s = highlights.run_up_s if highlights else None
    return rrb.Blueprint(
        rrb.Tabs(
            overview(draw, detail_s, contents),
            start_up(draw, run_up_s, contents),
            estimator(draw, detail_s, contents),
            *([impacts(draw, detail_s, contents)] if contents.impacts else []),
            *([gait(draw, detail_s)] if contents.walked else []),
            bus_and_timing(draw, contents),
            about(),
        ),
        time_panel(detail_s, contents.failed),
        collapse_panels=True,
    )


def time_panel(detail_s: tuple[float, float] | None, failed: bool) -> rrb.TimePanel:
    """The time cursor: at the newest data, through the whole run, or in a loop around a failed check."""
    if detail_s is None:
        return rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="following")
    if not failed:
        return rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="playing")
    edges_ns = (round(1e9 * edge_s) for edge_s in detail_s)
    return rrb.TimePanel(
        timeline="sim_time",
        state="collapsed",
        play_state="playing",
        loop_mode="selection",
        time_selection=rrb.components.AbsoluteTimeRange(*edges_ns),
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
    """The layout of two runs in one recording, with a close-up of their first difference."""
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
                plot("True position, b − a [mm]", Whole("/b_minus_a/x_mm"), legend=None),
                plot("Crank speed, b − a [rad/s]", Whole("/b_minus_a/omega_rad_s"), legend=None),
            ),
            rrb.Horizontal(
                both("Crank speed [rad/s]", "/plant", "omega_rad_s", "rad/s"),
                plot(
                    "Impacts, v⁻ [m/s]",
                    Dots("/a/impacts/truth", "v_m_s", "a", TRUTH, "circle"),
                    Dots("/b/impacts/truth", "v_m_s", "b", ESTIMATE, "cross"),
                    legend=rrb.Corner2D.LeftBottom,
                ),
                both("Requested torque [N m]", "/firmware", "outputs.torque_n_m", "N m"),
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
