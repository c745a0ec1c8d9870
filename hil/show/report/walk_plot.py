"""The plot of a walk: the phase of each pulse in the gait cycle over the run."""

import numpy as np

from hil.judge.figures.gait import pulses_of, push_off
from hil.judge.figures.records import Figures
from hil.record.run_traces import RunTraces
from hil.show.report import chart


def walk(traces: RunTraces, figures: Figures) -> chart.Plot:
    """The phases of the pulses, with the window for them, the hold, and the end of the walk."""
    window = push_off(traces.scenario)
    pulses = pulses_of(traces.plant, traces.impacts)
    inside, known = window.holds(pulses.phase), np.isfinite(pulses.phase)
    drawn = [
        chart.points(1, name, pulses.t_s[which], 100.0 * pulses.phase[which], color, symbol)
        for which, color, name, symbol in (
            (inside, chart.GOOD, "pulse in the window", "circle"),
            (known & ~inside, chart.ALARM, "pulse of another turn", "x"),
        )
    ]
    drawn += [
        chart.level(1, "window", 100.0 * edge, 0.0, figures.duration_s, chart.GOOD, "dash") for edge in window
    ]
    edges_s = (figures.hold_start_s, figures.hold_end_s, figures.gait.end_s)
    lines = [chart.upright(1, edge_s) for edge_s in edges_s if edge_s is not None]
    found = figures.gait
    text = (
        "No stride was held."
        if found.in_window is None or found.outside_per_stride is None
        else f"Of {found.strides} strides {100.0 * found.in_window:.0f} % have a pulse in the window "
        f"(dashed), with {found.outside_per_stride:.2f} others a stride."
    )
    ending = "" if found.end is None else f", and the {found.end}"
    panel = chart.Panel("gait cycle [%]", "simulated time [s]", y_axis={"range": [0.0, 100.0]})
    return chart.Plot(
        "Pulses over the gait cycle",
        f"{text} Dotted: the beginning and the end of the hold{ending}.",
        chart.chart(320, [panel], drawn, lines),
    )
