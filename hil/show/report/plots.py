"""The plots of a report: each explains a part of the verdict."""

from collections.abc import Callable

import numpy as np

from hil.judge import detection
from hil.judge.figures.bus import bits_by_tenth, load_over_time
from hil.judge.figures.records import Figures
from hil.record.candump import TENTH_S
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.show.report import chart
from hil.show.report.course_plot import course
from hil.show.report.walk_plot import walk

PORTRAIT_PERIODS = 12


def within(records: Records, start_s: float, end_s: float) -> Records:
    """The records in an interval of time."""
    t_s = column(records, "t_s")
    some: Records = records[(t_s >= start_s) & (t_s <= end_s)]
    return some


def stop_of(traces: RunTraces) -> float | None:
    """The stop's position, in m."""
    position = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    return None if position is None else float(position)


def start_up(traces: RunTraces, figures: Figures) -> chart.Plot:
    """Position, impacts and crank speed from the first motion to just after the run-up."""
    start_s, end_s = run_up(traces, figures)
    plant, firmware = within(traces.plant, start_s, end_s), within(traces.firmware, start_s, end_s)
    touched = within(traces.impacts, start_s, end_s)
    plant_s, firmware_s = column(plant, "t_s"), column(firmware, "t_s")
    target_rad_s = column(firmware, "outputs.target_omega_rad_s")
    position, speed, crank = 1, 2, 3
    drawn = [
        chart.curve(
            position, "estimate", firmware_s, 1e3 * column(firmware, "state.estimator.x_m"), chart.ESTIMATE
        ),
        chart.curve(position, "true position", plant_s, 1e3 * column(plant, "x_m"), chart.TRUTH),
        chart.points(speed, "true impact", column(touched, "t_s"), column(touched, "v_m_s"), chart.TRUTH),
        chart.curve(crank, "true speed", plant_s, column(plant, "omega_rad_s"), chart.TRUTH),
        chart.curve(crank, "target speed", firmware_s, target_rad_s, chart.TARGET, dash="dash"),
    ]
    if (stop_m := stop_of(traces)) is not None:
        drawn.append(chart.level(position, "stop", 1e3 * stop_m, start_s, end_s, chart.ALARM))
    panels = chart.stacked([("x [mm]", 2.0), ("v⁻ [m/s]", 1.0), ("Ω [rad/s]", 1.0)], "simulated time [s]")
    panels[1] = panels[1]._replace(y_axis={"rangemode": "tozero"})
    marked = ((figures.hold_start_s, chart.NEUTRAL), (figures.capture_s, chart.GOOD))
    lines = [chart.upright(crank, at_s, color) for at_s, color in marked if at_s is not None]
    captured = (
        "Never captured."
        if figures.capture_s is None
        else f"Captured at {figures.capture_s:.2f} s (green): every later drive period has its impact."
    )
    return chart.Plot(
        "Start-up",
        f"From the first motion to just after the run-up (dotted). {captured}",
        chart.chart(480, panels, drawn, lines),
    )


def run_up(traces: RunTraces, figures: Figures) -> tuple[float, float]:
    """The time window of the run-up."""
    moving = np.flatnonzero(column(traces.firmware, "outputs.target_omega_rad_s") > 0.0)
    start_s = float(column(traces.firmware, "t_s")[moving[0]]) if len(moving) else 0.0
    end_s = figures.duration_s if figures.hold_start_s is None else figures.hold_start_s + 2.0
    return start_s, min(end_s, figures.duration_s)


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
        half=True,
    )


def distributions(traces: RunTraces, _: Figures) -> chart.Plot | None:
    """Histograms of detection latency, approach speed and peak force, as available; None without any."""
    detected_s = column(detection.reported(traces.firmware), "t_s")
    pairs = detection.match(column(traces.impacts, "t_s"), detected_s)
    samples = (
        (1e3 * pairs.latency_s, chart.ESTIMATE, "detection latency [ms]"),
        (column(traces.impacts, "v_m_s"), chart.TRUTH, "v⁻ [m/s]"),
        (column(traces.impacts, "peak_force_n"), chart.TRUTH, "peak force [N]"),
    )
    shown = [
        (values[np.isfinite(values)], color, label)
        for values, color, label in samples
        if np.isfinite(values).any()
    ]
    if not shown:
        return None
    panels = chart.side_by_side([label for _, _, label in shown], "impacts")
    drawn = []
    for panel, (values, color, label) in enumerate(shown, 1):
        spread = float(np.ptp(values)) or max(abs(float(values[0])) * 0.02, 1e-9)
        middle = 0.5 * float(values.min() + values.max())
        half = max(spread, 0.02 * abs(middle)) * 0.55
        counts, edges = np.histogram(values, bins=24, range=(middle - half, middle + half))
        drawn.append(chart.columns(panel, label, edges, counts, color))
        panels[panel - 1] = panels[panel - 1]._replace(y_axis={"nticks": min(int(counts.max()), 5) + 1})
    return chart.Plot(
        "Detection and impacts",
        "From touch-down to the tick that reports it; how fast, how hard.",
        chart.chart(250, panels, drawn),
        half=len(shown) == 1,
    )


LOOP_TIMES = (("work_us", "work [µs]"), ("wake_latency_us", "wake-up latency [µs]"))


def timing(traces: RunTraces, figures: Figures) -> chart.Plot | None:
    """Bus load, and work and wake-up latency of both loops if measured; None without any."""
    loops = ((traces.plant, chart.TRUTH, "plant"), (traces.firmware, chart.ESTIMATE, "firmware"))
    measured = [
        (label, [(column(records, name), color, loop) for records, color, loop in loops])
        for name, label in LOOP_TIMES
        if figures.clock == "real" and any((column(records, name) > 0.0).any() for records, _, _ in loops)
    ]
    bits = bits_by_tenth(traces.bus.counts)
    whole = {n: sent for n, sent in bits.items() if (n + 1) * TENTH_S <= figures.duration_s}
    if not (measured or whole):
        return None
    panels = chart.side_by_side(
        [label for label, _ in measured] + ["simulated time [s]"] * bool(whole), "ticks"
    )
    logarithmic = {"type": "log", "exponentformat": "power"}
    drawn = []
    for panel, (_, samples) in enumerate(measured, 1):
        panels[panel - 1] = panels[panel - 1]._replace(x_axis=logarithmic, y_axis=logarithmic)
        every = np.concatenate([sample[sample > 0.0] for sample, _, _ in samples])
        edges = np.geomspace(0.9 * every.min(), 1.1 * every.max(), 60)
        for sample, color, loop in samples:
            counts, _ = np.histogram(sample, bins=edges)
            drawn.append(chart.outline(panel, loop, edges, counts, color, named=panel == 1))
    if whole:
        t_s, fraction = load_over_time(whole)
        panels[-1] = panels[-1]._replace(y_title="bus load [%]", y_axis={"rangemode": "tozero"})
        drawn.append(
            chart.curve(len(panels), "bus load", t_s, 100.0 * fraction, chart.OTHER) | {"showlegend": False}
        )
    loops_text = f"{figures.loops.plant.overruns} and {figures.loops.firmware.overruns} ticks skipped"
    title = "Clockwork and bus" if measured else "Bus"
    caption = f"Plant and firmware: {loops_text}." if measured else "Its load."
    return chart.Plot(title, caption, chart.chart(250, panels, drawn), half=len(panels) == 1)


PLOTS: tuple[Callable[[RunTraces, Figures], chart.Plot | None], ...] = (
    course,
    start_up,
    portrait,
    distributions,
    timing,
)


def plots(traces: RunTraces, figures: Figures) -> list[chart.Plot]:
    """The plots of a report in order, without empty ones; a run with a gait has a plot of the walk."""
    walked = traces.is_walked and len(traces.plant) > 0 and len(traces.firmware) > 0
    drawn = [draw(traces, figures) for draw in (PLOTS[0], *([walk] if walked else []), *PLOTS[1:])]
    return [plot for plot in drawn if plot is not None]
