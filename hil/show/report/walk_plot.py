"""The plot of a walk: the pulses over the gait cycle, and the error of the estimated phase."""

import numpy as np

from hil.judge.figures.gait import phase_error, pulses_of, push_off
from hil.judge.figures.records import Figures
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.show.report import chart
from plant_sim.arrays import BoolArray, FloatArray

ANKLE, COUNTED, CYCLE, FELT, ERROR = 1, 2, 3, 4, 5
LEFT, RIGHT = (0.0, 0.46), (0.56, 1.0)
GAIT_AXIS = {"range": [0.0, 100.0]}
CLASSES = np.linspace(0.0, 100.0, 41)
"""Edges of the histogram's classes, in % of the gait cycle."""


def walk(traces: RunTraces, figures: Figures) -> chart.Plot:
    """The phases of the pulses in the gait cycle, and the error of the estimated phase."""
    window = push_off(traces.scenario)
    pulses = pulses_of(traces.plant, traces.impacts)
    percent = 100.0 * pulses.phase
    known, inside = np.isfinite(pulses.phase), window.holds(pulses.phase)
    held = _held(pulses.t_s, figures)
    kinds = (
        (inside, chart.GOOD, "in the window", "circle"),
        (known & ~inside, chart.ALARM, "of another turn", "x"),
    )
    drawn = [chart.curve(ANKLE, "ankle moment", *push_off_curve(traces.plant), chart.TRUTH)]
    for which, color, name, symbol in kinds:
        counts, _ = np.histogram(percent[held & which], bins=CLASSES)
        drawn.append(chart.columns(COUNTED, name, CLASSES, counts, color))
        drawn.append(chart.points(CYCLE, f"pulse {name}", percent[which], pulses.t_s[which], color, symbol))
    if traces.is_worn:
        felt_n = column(traces.plant, "felt_force_n")
        drawn.append(
            chart.curve(FELT, "felt force", column(traces.plant, "t_s"), felt_n, chart.TRUTH, width=0.8)
        )
    t_s, off = phase_error(traces.plant, traces.firmware)
    drawn.append(chart.curve(ERROR, "phase error", t_s, 100.0 * off, chart.ESTIMATE, width=0.8))
    shapes = [chart.band(CYCLE, 100.0 * window.start, 100.0 * window.end, chart.GOOD)]
    if figures.hold_start_s is not None and figures.hold_end_s is not None:
        shapes.append(chart.band(ERROR, figures.hold_start_s, figures.hold_end_s, chart.TARGET))
    found = figures.gait
    if found.end_s is not None:
        shapes.append(chart.upright(ERROR, found.end_s))
        drawn.append(chart.level(CYCLE, str(found.end), found.end_s, 0.0, 100.0, chart.NEUTRAL, "dot"))
    text = (
        "No stride was held."
        if found.in_window is None or found.outside_per_stride is None
        else f"Of {found.strides} strides {100.0 * found.in_window:.0f} % have a pulse in the window "
        f"(green), with {found.outside_per_stride:.2f} others a stride."
    )
    text += " The ankle's moment over the body's mass pushes off."
    worn = "" if traces.is_worn else " Nobody wears the module."
    ending = "" if found.end is None else f" The dotted line is the {found.end}."
    return chart.Plot(
        "Pulses over the gait cycle",
        f"{text}{worn} The hold is shaded on the right.{ending}",
        chart.chart(460, panels(figures.duration_s), drawn, shapes, barmode="stack"),
    )


def panels(duration_s: float) -> list[chart.Panel]:
    """Left, over the gait cycle: moment, counts, pulses; right, over time: felt force, phase error."""
    few, time = {"nticks": 4}, {"range": [0.0, duration_s]}
    error = {"range": [-15.0, 15.0]}
    return [
        chart.Panel("N m/kg", "", LEFT, (0.84, 1.0), CYCLE, GAIT_AXIS, few),
        chart.Panel("in the hold", "", LEFT, (0.63, 0.79), CYCLE, GAIT_AXIS, few),
        chart.Panel(
            "simulated time [s]",
            "gait cycle [%]",
            LEFT,
            (0.0, 0.58),
            None,
            GAIT_AXIS,
            {"range": [duration_s, 0.0]},
        ),
        chart.Panel("felt [N]", "", RIGHT, (0.63, 1.0), ERROR, time),
        chart.Panel("phase error [%]", "simulated time [s]", RIGHT, (0.0, 0.58), None, time, error),
    ]


def push_off_curve(plant: Records) -> tuple[FloatArray, FloatArray]:
    """Mean ankle moment in N m/kg over the gait cycle in %, for each hundredth of the cycle with data."""
    phase, moment = column(plant, "gait.phase"), column(plant, "gait.ankle_n_m_kg")
    known = np.isfinite(phase)
    places = np.minimum((100.0 * phase[known]).astype(int), 99)
    counts = np.bincount(places, minlength=100)
    sums: FloatArray = np.bincount(places, weights=moment[known], minlength=100).astype(np.float64)
    walked = np.flatnonzero(counts)
    return walked.astype(np.float64) + 0.5, sums[walked] / counts[walked]


def _held(t_s: FloatArray, figures: Figures) -> BoolArray:
    """Mask of the times within the hold."""
    if figures.hold_start_s is None or figures.hold_end_s is None:
        return np.zeros(len(t_s), bool)
    return (t_s >= figures.hold_start_s) & (t_s <= figures.hold_end_s)
