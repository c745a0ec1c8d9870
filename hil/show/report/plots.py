"""The plots of a report: each explains a part of the verdict."""

from collections.abc import Callable

import numpy as np

from hil.judge import detection
from hil.judge.figures.bus import bits_by_tenth, load_over_time
from hil.judge.figures.gait import phase_error, pulses_of, push_off
from hil.judge.figures.records import Figures
from hil.record.candump import TENTH_S
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.show.report.axes import DASHED, DOTTED, FAINT, INK, stroke
from hil.show.report.canvas import (
    ALARM,
    ESTIMATE,
    GOOD,
    LEFT_PX,
    OTHER,
    TARGET,
    TRUTH,
    Figure,
    Plot,
    thinned,
)
from hil.show.report.course_plot import course
from plant_sim.arrays import BoolArray, FloatArray

PORTRAIT_PERIODS = 12


def within(records: Records, start_s: float, end_s: float) -> Records:
    """The records of a stretch of time."""
    t_s = column(records, "t_s")
    some: Records = records[(t_s >= start_s) & (t_s <= end_s)]
    return some


def stop_of(traces: RunTraces) -> float | None:
    """Where the stop is, in metres."""
    position = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    return None if position is None else float(position)


def start_up(traces: RunTraces, figures: Figures) -> Plot:
    """Position, impacts and crank speed from the first motion to just after the run-up."""
    start_s, end_s = run_up(traces, figures)
    plant, firmware = within(traces.plant, start_s, end_s), within(traces.firmware, start_s, end_s)
    touched = within(traces.impacts, start_s, end_s)
    figure = Figure("start-up", 920, 480)
    position, speed, crank = figure.stacked(2.0, 1.0, 1.0)
    estimated = thinned(column(firmware, "t_s"), 1e3 * column(firmware, "state.estimator.x_m"))
    position.curve(*estimated, ESTIMATE, "estimate")
    position.curve(*thinned(column(plant, "t_s"), 1e3 * column(plant, "x_m")), TRUTH, "true position")
    if (stop_m := stop_of(traces)) is not None:
        position.across(1e3 * stop_m, ALARM, label="stop", width=1.3)
    position.y_label = "x [mm]"
    position.legend = "lower left"
    touched_s, touched_m_s = column(touched, "t_s"), column(touched, "v_m_s")
    speed.segments((touched_s, np.zeros_like(touched_s)), (touched_s, touched_m_s), stroke(TRUTH, 1.0))
    speed.points(touched_s, touched_m_s, TRUTH)
    speed.y.from_zero = True
    speed.y_label = "v⁻ [m/s]"
    crank.curve(*thinned(column(plant, "t_s"), column(plant, "omega_rad_s")), TRUTH, "true", width=1.6)
    target = column(firmware, "outputs.target_omega_rad_s")
    crank.curve(*thinned(column(firmware, "t_s"), target), TARGET, "target", width=1.6, dash=DASHED)
    crank.y_label, crank.x_label = "Ω [rad/s]", "simulated time [s]"
    crank.legend = "lower right"
    for axes in (position, speed, crank):
        if figures.hold_start_s is not None:
            axes.across(figures.hold_start_s, INK, upright=True, dash=DOTTED)
        if figures.capture_s is not None:
            axes.across(figures.capture_s, GOOD, upright=True, dash=DOTTED)
    captured = (
        "Never captured."
        if figures.capture_s is None
        else f"Captured at {figures.capture_s:.2f} s (green): every later drive period has its impact."
    )
    return Plot(
        "Start-up",
        f"From the first motion to just after the run-up (dotted). {captured}",
        figure.svg(),
    )


def run_up(traces: RunTraces, figures: Figures) -> tuple[float, float]:
    """When the run-up is worth looking at."""
    moving = np.flatnonzero(column(traces.firmware, "outputs.target_omega_rad_s") > 0.0)
    start_s = float(column(traces.firmware, "t_s")[moving[0]]) if len(moving) else 0.0
    end_s = figures.duration_s if figures.hold_start_s is None else figures.hold_start_s + 2.0
    return start_s, min(end_s, figures.duration_s)


def portrait(traces: RunTraces, figures: Figures) -> Plot | None:
    """The orbit at the end of the hold, true and estimated; None where nothing was held."""
    if figures.hold_start_s is None or figures.hold_end_s is None or figures.speed.mean_rad_s is None:
        return None
    span_s = PORTRAIT_PERIODS * 2.0 * np.pi / abs(figures.speed.mean_rad_s)
    start_s = max(figures.hold_start_s, figures.hold_end_s - span_s)
    estimated = within(traces.firmware, start_s, figures.hold_end_s)
    truth = within(traces.plant, start_s, figures.hold_end_s)
    figure = Figure("portrait", 450, 345)
    (axes,) = figure.beside(1)
    for records, x, v, color, label in (
        (estimated, "state.estimator.x_m", "state.estimator.v_m_s", ESTIMATE, "estimate"),
        (truth, "x_m", "v_m_s", TRUTH, "truth"),
    ):
        axes.curve(1e3 * column(records, x), column(records, v), color, label, width=1.0)
    if (stop_m := stop_of(traces)) is not None:
        axes.across(1e3 * stop_m, ALARM, upright=True, label="stop", width=1.3)
    axes.x_label, axes.y_label = "x [mm]", "v [m/s]"
    axes.legend = "upper left"
    return Plot(
        "Phase portrait", f"The last {PORTRAIT_PERIODS} drive periods of the hold.", figure.svg(), half=True
    )


def distributions(traces: RunTraces, _: Figures) -> Plot | None:
    """Detection latency, approach speed and peak force, of those that the run has; None without any."""
    seen = traces.firmware[column(traces.firmware, "outputs.impact") != 0.0]
    pairs = detection.match(column(traces.impacts, "t_s"), column(seen, "t_s"))
    latency_ms = 1e3 * (column(seen, "t_s")[pairs.detection] - column(traces.impacts, "t_s")[pairs.truth])
    samples = (
        (latency_ms, ESTIMATE, "detection latency [ms]"),
        (column(traces.impacts, "v_m_s"), TRUTH, "v⁻ [m/s]"),
        (column(traces.impacts, "peak_force_n"), TRUTH, "peak force [N]"),
    )
    shown = [
        (values[np.isfinite(values)], color, label)
        for values, color, label in samples
        if np.isfinite(values).any()
    ]
    if not shown:
        return None
    figure = Figure("distributions", 307 * len(shown), 250)
    for axes, (values, color, label) in zip(figure.beside(len(shown)), shown, strict=True):
        spread = float(np.ptp(values)) or max(abs(float(values[0])) * 0.02, 1e-9)
        middle = 0.5 * float(values.min() + values.max())
        half = max(spread, 0.02 * abs(middle)) * 0.55
        counts, edges = np.histogram(values, bins=24, range=(middle - half, middle + half))
        axes.bars(counts, edges, color)
        axes.y.from_zero = axes.whole_y = True
        axes.x_label = label
    figure.axes[0].y_label = "impacts"
    return Plot(
        "Detection and impacts",
        "From touch-down to the tick that reports it; how fast, how hard.",
        figure.svg(),
        half=len(shown) == 1,
    )


LOOP_TIMES = (("work_us", "work [µs]"), ("wake_latency_us", "wake-up latency [µs]"))


def timing(traces: RunTraces, figures: Figures) -> Plot | None:
    """The bus, and where they were measured work and wake-up latency of both loops; None without any."""
    loops = ((traces.plant, TRUTH, "plant"), (traces.firmware, ESTIMATE, "firmware"))
    measured = [
        (label, [(column(records, name), color, loop) for records, color, loop in loops])
        for name, label in LOOP_TIMES
        if figures.clock == "real" and any((column(records, name) > 0.0).any() for records, _, _ in loops)
    ]
    bits = bits_by_tenth(traces.bus.counts)
    whole = {n: sent for n, sent in bits.items() if (n + 1) * TENTH_S <= figures.duration_s}
    columns = len(measured) + bool(whole)
    if not columns:
        return None
    figure = Figure("timing", 307 * columns, 250)
    all_axes = figure.beside(columns)
    for axes, (label, samples) in zip(all_axes, measured, strict=False):
        axes.x.is_log = axes.y.is_log = True
        positive = [(sample[sample > 0.0], color, loop) for sample, color, loop in samples]
        every = np.concatenate([sample for sample, _, _ in positive])
        bins = np.geomspace(0.9 * every.min(), 1.1 * every.max(), 60)
        for sample, color, loop in positive:
            axes.outline(np.histogram(sample, bins)[0], bins, color, loop)
        axes.x_label, axes.y_label = label, "ticks"
        axes.legend = "upper right"
    if whole:
        t_s, fraction = load_over_time(whole)
        all_axes[-1].curve(t_s, 100.0 * fraction, OTHER)
        all_axes[-1].x_label, all_axes[-1].y_label = "simulated time [s]", "bus load [%]"
        all_axes[-1].y.from_zero = True
    loops_text = f"{figures.loops.plant.overruns} and {figures.loops.firmware.overruns} ticks skipped"
    title = "Clockwork and bus" if measured else "Bus"
    caption = f"Plant and firmware: {loops_text}." if measured else "Its load."
    return Plot(title, caption, figure.svg(), half=columns == 1)


def walk(traces: RunTraces, figures: Figures) -> Plot:
    """Where in the gait cycle the pulses come, and how far off the estimated phase is."""
    window = push_off(traces.scenario)
    pulses = pulses_of(traces.plant, traces.impacts)
    figure = Figure("walk", 920, 400)
    top, middle = 28.0, 460.0
    histogram, cycle = figure.stacked(1.0, 2.0, right=middle + 20.0, top=top)
    felt, error = figure.stacked(1.0, 2.0, left=middle + 30.0 + LEFT_PX, top=top)
    for axes in (histogram, cycle):
        axes.band(100.0 * window.start, 100.0 * window.end, GOOD, 0.18)
    known = np.isfinite(pulses.phase)
    inside = window.holds(pulses.phase)
    held = _held(pulses.t_s, figures)
    edges = np.linspace(0.0, 100.0, 41)
    within_window = np.histogram(100.0 * pulses.phase[held & inside], edges)[0]
    outside = np.histogram(100.0 * pulses.phase[held & known & ~inside], edges)[0]
    histogram.bars(within_window, edges, GOOD)
    histogram.bars(outside, edges, ALARM, below=within_window)
    histogram.y_label = "in the hold"
    histogram.y.from_zero = histogram.whole_y = True
    ankle = figure.on_the_right_of(histogram)
    ankle.curve(*push_off_curve(traces.plant), TRUTH, width=1.6)
    ankle.y_label, ankle.y_color = "ankle [N m/kg]", TRUTH
    for which, cross, color, label in (
        (inside, False, GOOD, "pulse in the window"),
        (known & ~inside, True, ALARM, "outside: of another turn of the stride"),
    ):
        cycle.points(100.0 * pulses.phase[which], pulses.t_s[which], color, label, cross)
    cycle.x_label, cycle.y_label = "gait cycle [%]", "simulated time [s]"
    cycle.x.fixed, cycle.y.fixed = (0.0, 100.0), (figures.duration_s, 0.0)
    # Pulses may be anywhere in both plots: the legend stands over them.
    histogram.legend, histogram.named = "above", cycle.named
    if traces.is_worn:
        felt.curve(
            *thinned(column(traces.plant, "t_s"), column(traces.plant, "felt_force_n")), TRUTH, width=1.0
        )
        felt.y_label = "felt [N]"
    else:
        felt.say("nobody wears the module")
    t_s, off = phase_error(traces.plant, traces.firmware)
    if len(t_s):
        error.curve(*thinned(t_s, 100.0 * off), ESTIMATE, width=1.0)
    error.across(0.0, FAINT)
    error.x_label, error.y_label = "simulated time [s]", "phase error [% of the cycle]"
    error.y.fixed = (-15.0, 15.0)
    for axes in (felt, error):
        if figures.hold_start_s is not None and figures.hold_end_s is not None:
            axes.band(figures.hold_start_s, figures.hold_end_s, TARGET, 0.12)
        if figures.gait.end_s is not None:
            axes.across(figures.gait.end_s, INK, upright=True, dash=DOTTED)
    if figures.gait.end_s is not None:
        cycle.across(figures.gait.end_s, INK, dash=DOTTED)
    found = figures.gait
    text = (
        "No stride was held."
        if found.in_window is None or found.outside_per_stride is None
        else f"Of {found.strides} strides {100.0 * found.in_window:.0f} % have a pulse in the window "
        f"(green), with {found.outside_per_stride:.2f} others a stride."
    )
    text += " The curve is the ankle's moment over the body's mass, which pushes off."
    ending = "" if found.end is None else f" The dotted line is the {found.end}."
    return Plot(
        "Pulses over the gait cycle", f"{text} The hold is shaded on the right.{ending}", figure.svg()
    )


def push_off_curve(plant: Records) -> tuple[FloatArray, FloatArray]:
    """The ankle's mean moment, N m/kg, in each hundredth of the gait cycle, %, that was walked."""
    phase, moment = column(plant, "gait.phase"), column(plant, "gait.ankle_n_m_kg")
    known = np.isfinite(phase)
    places = np.minimum((100.0 * phase[known]).astype(int), 99)
    counts = np.bincount(places, minlength=100)
    sums: FloatArray = np.bincount(places, weights=moment[known], minlength=100).astype(np.float64)
    walked = np.flatnonzero(counts)
    return walked.astype(np.float64) + 0.5, sums[walked] / counts[walked]


def _held(t_s: FloatArray, figures: Figures) -> BoolArray:
    """Which times lie within the hold."""
    if figures.hold_start_s is None or figures.hold_end_s is None:
        return np.zeros(len(t_s), bool)
    return (t_s >= figures.hold_start_s) & (t_s <= figures.hold_end_s)


PLOTS: tuple[Callable[[RunTraces, Figures], Plot | None], ...] = (
    course,
    start_up,
    portrait,
    distributions,
    timing,
)


def plots(traces: RunTraces, figures: Figures) -> list[Plot]:
    """The plots of a report that have something to show, in order; that of the gait where somebody walks."""
    walked = traces.is_walked and len(traces.plant) > 0 and len(traces.firmware) > 0
    drawn = [draw(traces, figures) for draw in (PLOTS[0], *([walk] if walked else []), *PLOTS[1:])]
    return [plot for plot in drawn if plot is not None]
