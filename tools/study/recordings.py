"""Sweeps and portraits as Rerun recordings: the orbit over the ratio, and the motion over time.

Orbits are drawn dimensionless, (x − l0)/gap to the right and x'/(ω gap) upwards, so that the stop is at 1 and
all modules have the same scale. A sweep's timeline is the ratio in thousandths, a portrait's timeline is the
time.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from hil.record.state_timeline import ALARM, ESTIMATE, OTHER, TRUTH
from hil.show.log_stream import recorded
from tools.study.cases import Case
from tools.study.portraits import Motion, Pair, sample, with_impacts
from tools.study.sweep import Diagram, Sweep

RATIO_LINE = "r_thousandths"
TIME_LINE = "sim_time"
ORBIT_PERIODS = 2
"""Drawn periods of an orbit; some orbits near r = 0.9 repeat after two periods."""
ORBIT_POINTS = 240
FRAME_S = 0.01


class Way(NamedTuple):
    """Style of a run-up or a run-down: thin lines above wide ones, so that both are visible if they coincide.

    `above` is the order of overlapping lines; Rerun orders overlapping dots by their names.
    """

    name: str
    rgba: int
    width: float
    above: float
    dot: float


RUN_UP, RUN_DOWN = Way("run-up", TRUTH, 1.8, 1.0, 1.7), Way("run-down", ESTIMATE, 0.8, 2.0, 3.5)

Orbit = NDArray[np.float64]
"""Points in the drawn plane, shape (n, 2); the screen's second axis points down."""


def drawn(case: Case, x_m: NDArray[np.float64], v_m_s: NDArray[np.float64]) -> Orbit:
    """Return states in the picture's units, shape (n, 2)."""
    return np.column_stack(
        ((x_m - case.rest_length_m) / case.gap_m, -v_m_s / (case.natural_rad_s * case.gap_m))
    )


def orbit(case: Case, sweep: Sweep, ratio: float) -> Orbit:
    """Return the settled orbit of a sweep at a ratio, with the states before and after each impact."""
    turn_s = 2.0 * np.pi / (ratio * case.natural_rad_s)
    t_s = np.linspace(0.0, ORBIT_PERIODS * turn_s, ORBIT_POINTS)
    _, x_m, v_m_s = with_impacts(case, sample(case, ratio, sweep.state_at(ratio), t_s))
    return drawn(case, x_m, v_m_s)


def colour(rgba: int) -> NDArray[np.uint32]:
    """Return one colour in the type that the SDK accepts without conversion."""
    return np.array([rgba], np.uint32)


def stop_line(recording: rr.RecordingStream, name: str) -> None:
    """Log the stop as a static line."""
    line = rr.LineStrips2D([[[1.0, -2.5], [1.0, 2.5]]], colors=colour(ALARM), radii=rr.Radius.ui_points(0.7))
    recording.log(f"{name}/stop", line, static=True)


def plane(name: str, origin: str) -> rrb.Spatial2DView:
    """Return a view of the plane of states."""
    bounds = rrb.VisualBounds2D(x_range=[-2.2, 1.4], y_range=[-2.2, 2.2])
    return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds)


def titled(case: Case) -> str:
    """Return the title of a case's view."""
    return f"{case.preset}, {case.label}"


def entity(case: Case) -> str:
    """Return the entity path of a case."""
    return f"{case.preset}/{case.law}"


def sweeps(diagrams: Sequence[Diagram], path: Path) -> None:
    """Write a recording of the settled orbits of run-up and run-down over the ratio, with their v⁻."""
    cases = [diagram.case for diagram in diagrams]
    layout = rrb.Blueprint(
        rrb.Vertical(
            rrb.Grid(*(plane(titled(case), f"/{entity(case)}/orbits") for case in cases), grid_columns=3),
            rrb.Grid(
                *(
                    rrb.TimeSeriesView(
                        origin=f"/{entity(case)}/speeds",
                        name=f"{titled(case)}: v⁻ at the stop [m/s]",
                        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
                    )
                    for case in cases
                ),
                grid_columns=3,
            ),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=RATIO_LINE, state="collapsed", play_state="playing", fps=10.0),
        collapse_panels=True,
    )
    with recorded(path, "amplitude–frequency diagrams", layout) as recording:
        for diagram in diagrams:
            name = entity(diagram.case)
            stop_line(recording, f"{name}/orbits")
            for sweep, way in ((diagram.up, RUN_UP), (diagram.down, RUN_DOWN)):
                _one_way(recording, diagram.case, sweep, way)


def _one_way(recording: rr.RecordingStream, case: Case, sweep: Sweep, way: Way) -> None:
    """Log the orbits and v⁻ of a run-up or a run-down."""
    orbits, speeds = f"{entity(case)}/orbits/{way.name}", f"{entity(case)}/speeds/{way.name}"
    order = np.argsort(sweep.column("ratio"))
    ratios = sweep.column("ratio")[order]
    steps = [rr.TimeColumn(RATIO_LINE, sequence=np.round(1000.0 * ratios).astype(np.int64))]
    style = rr.LineStrips2D.from_fields(
        colors=colour(way.rgba), radii=rr.Radius.ui_points(way.width), draw_order=way.above
    )
    recording.log(orbits, style, static=True)
    strips = [orbit(case, sweep, float(ratio)) for ratio in ratios]
    recording.send_columns(orbits, steps, [*rr.LineStrips2D.columns(strips=strips)])
    dots = rr.SeriesPoints(colors=colour(way.rgba), markers="circle", marker_sizes=way.dot, names=way.name)
    recording.log(speeds, dots, static=True)
    values = sweep.column("v_max_m_s")[order]
    recording.send_columns(speeds, steps, [*rr.Scalars.columns(scalars=values)])


def portraits(pairs: Sequence[Pair], path: Path) -> None:
    """Write a recording of both motions of each law over time, with their Poincaré points."""
    motions = [
        (both.case, kind, motion)
        for kind in ("impact", "non-impact")
        for both in pairs
        if (motion := both.impact if kind == "impact" else both.non_impact) is not None
    ]
    views = [
        plane(f"{titled(case)}: {kind}, Ω/ω = {motion.ratio:g}", f"/{entity(case)}/{kind}")
        for case, kind, motion in motions
    ]
    layout = rrb.Blueprint(
        rrb.Grid(*views, grid_columns=len(pairs)),
        rrb.TimePanel(timeline=TIME_LINE, state="collapsed", play_state="playing", playback_speed=0.25),
        collapse_panels=True,
    )
    with recorded(path, f"portraits, {pairs[0].case.preset}", layout) as recording:
        for case, kind, motion in motions:
            _run_through(recording, f"{entity(case)}/{kind}", motion)


def _run_through(recording: rr.RecordingStream, name: str, motion: Motion) -> None:
    """Log the static orbit, its Poincaré points, and the state that moves along the orbit."""
    case = motion.case
    stop_line(recording, name)
    whole = drawn(case, motion.x_m, motion.v_m_s)
    rgba = ESTIMATE if motion.reaches_stop else TRUTH
    path = rr.LineStrips2D([whole], colors=colour(rgba), radii=rr.Radius.ui_points(0.7))
    recording.log(f"{name}/orbit", path, static=True)
    points = drawn(case, motion.points[:, 0], motion.points[:, 1])
    dots = rr.Points2D(points, colors=colour(OTHER), radii=rr.Radius.ui_points(3.0))
    recording.log(f"{name}/poincare", dots, static=True)
    # At an impact two states have the same time; the second is the state after the impact.
    frames_s = np.arange(0.0, motion.t_s[-1], FRAME_S)
    rows = np.searchsorted(motion.t_s, frames_s, side="right") - 1
    moving: dict[str, Any] = {"colors": colour(0xFFFFFFFF), "radii": rr.Radius.ui_points(5.0)}
    recording.log(f"{name}/striker", rr.Points2D.from_fields(**moving), static=True)
    times = [rr.TimeColumn(TIME_LINE, duration=frames_s)]
    recording.send_columns(f"{name}/striker", times, [*rr.Points2D.columns(positions=whole[rows])])
