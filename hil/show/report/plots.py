"""The plots of a report: the whole run, the walk, the orbit at the end. Rerun's log has all signals."""

import numpy as np

from hil.judge.figures.records import Figures
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.show.report import chart
from hil.show.report.course_plot import course, stop_of
from hil.show.report.walk_plot import walk

PORTRAIT_PERIODS = 12


def within(records: Records, start_s: float, end_s: float) -> Records:
    """The records in an interval of time."""
    t_s = column(records, "t_s")
    some: Records = records[(t_s >= start_s) & (t_s <= end_s)]
    return some


def portrait(traces: RunTraces, figures: Figures) -> chart.Plot | None:
    """The orbit at the end of the hold, true and estimated; None without a hold."""
    if figures.hold_start_s is None or figures.hold_end_s is None or figures.speed.mean_rad_s is None:
        return None
    span_s = PORTRAIT_PERIODS * 2.0 * np.pi / abs(figures.speed.mean_rad_s)
    start_s = max(figures.hold_start_s, figures.hold_end_s - span_s)
    estimated = within(traces.firmware, start_s, figures.hold_end_s)
    truth = within(traces.plant, start_s, figures.hold_end_s)
    drawn = [
        chart.curve(1, label, 1e3 * column(records, x), column(records, v), color)
        for records, x, v, color, label in (
            (estimated, "state.estimator.x_m", "state.estimator.v_m_s", chart.ESTIMATE, "estimate"),
            (truth, "x_m", "v_m_s", chart.TRUTH, "truth"),
        )
    ]
    stop_m = stop_of(traces)
    lines = [] if stop_m is None else [chart.upright(1, 1e3 * stop_m, chart.ALARM, "solid")]
    return chart.Plot(
        "Phase portrait",
        f"The last {PORTRAIT_PERIODS} drive periods of the hold{'' if stop_m is None else ', and the stop'}.",
        chart.chart(350, [chart.Panel("v [m/s]", "x [mm]")], drawn, lines),
    )


def plots(traces: RunTraces, figures: Figures) -> list[chart.Plot]:
    """The plots of a report in order; a run with a gait has a plot of the walk."""
    walked = traces.is_walked and len(traces.plant) > 0 and len(traces.firmware) > 0
    drawn = [course(traces, figures), walk(traces, figures) if walked else None, portrait(traces, figures)]
    return [plot for plot in drawn if plot is not None]
