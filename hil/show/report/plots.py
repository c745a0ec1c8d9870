"""The plots of a report: each explains a part of the verdict."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from hil.judge import detection
from hil.judge.figures.bus import bits_by_tenth, load_over_time
from hil.judge.figures.gait import phase_error, pulses_of, push_off
from hil.judge.figures.records import Figures
from hil.record.candump import TENTH_S
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.show.report.canvas import (
    ALARM,
    ESTIMATE,
    FAINT,
    GOOD,
    INK,
    OTHER,
    TARGET,
    TRUTH,
    Plot,
    canvas,
    svg_of,
    thinned,
)
from hil.show.report.course_plot import course
from plant_sim.arrays import BoolArray, FloatArray

PORTRAIT_PERIODS = 12


def nothing(axes: Axes, text: str) -> None:
    """Say on an empty plot why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=INK)
    axes.set_axis_off()


def within(records: Records, start_s: float, end_s: float) -> Records:
    """The records of a stretch of time."""
    t_s = column(records, "t_s")
    some: Records = records[(t_s >= start_s) & (t_s <= end_s)]
    return some


def stop_of(traces: RunTraces) -> float | None:
    """The stop's position, in m."""
    position = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    return None if position is None else float(position)


def start_up(traces: RunTraces, figures: Figures) -> Plot:
    """Position, impacts and crank speed from the first motion to just after the run-up."""
    start_s, end_s = run_up(traces, figures)
    plant, firmware = within(traces.plant, start_s, end_s), within(traces.firmware, start_s, end_s)
    touched = within(traces.impacts, start_s, end_s)
    with canvas(9.6, 5.0) as figure:
        position, speed, crank = figure.subplots(3, 1, sharex=True, height_ratios=[2.0, 1.0, 1.0])
        estimated = thinned(column(firmware, "t_s"), 1e3 * column(firmware, "state.estimator.x_m"))
        position.plot(*estimated, color=ESTIMATE, lw=0.9, label="estimate")
        t_s, x_mm = thinned(column(plant, "t_s"), 1e3 * column(plant, "x_m"))
        position.plot(t_s, x_mm, color=TRUTH, lw=0.9, label="true position")
        if (stop_m := stop_of(traces)) is not None:
            position.axhline(1e3 * stop_m, color=ALARM, lw=1.0, label="stop")
        position.set_ylabel("x [mm]")
        position.legend(loc="lower left", ncols=3)
        speed.vlines(column(touched, "t_s"), 0.0, column(touched, "v_m_s"), color=TRUTH, lw=0.8)
        speed.plot(column(touched, "t_s"), column(touched, "v_m_s"), ".", color=TRUTH, ms=4)
        speed.set_ylim(bottom=0.0)
        speed.set_ylabel("v⁻ [m/s]")
        crank.plot(*thinned(column(plant, "t_s"), column(plant, "omega_rad_s")), color=TRUTH, label="true")
        crank.plot(
            *thinned(column(firmware, "t_s"), column(firmware, "outputs.target_omega_rad_s")),
            color=TARGET,
            ls="--",
            label="target",
        )
        crank.set_ylabel("Ω [rad/s]")
        crank.set_xlabel("simulated time [s]")
        crank.legend(loc="lower right", ncols=2)
        for axes in (position, speed, crank):
            if figures.hold_start_s is not None:
                axes.axvline(figures.hold_start_s, color=INK, lw=0.8, ls=":")
            if figures.capture_s is not None:
                axes.axvline(figures.capture_s, color=GOOD, lw=0.8, ls=":")
        svg = svg_of(figure)
    captured = (
        "Never captured."
        if figures.capture_s is None
        else f"Captured at {figures.capture_s:.2f} s (green): every later drive period has its impact."
    )
    return Plot(
        "Start-up",
        f"From the first motion to just after the run-up (dotted). {captured}",
        svg,
    )


def run_up(traces: RunTraces, figures: Figures) -> tuple[float, float]:
    """The time window of the run-up."""
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
    with canvas(4.7, 3.6) as figure:
        axes = figure.subplots()
        for records, x, v, color, label in (
            (estimated, "state.estimator.x_m", "state.estimator.v_m_s", ESTIMATE, "estimate"),
            (truth, "x_m", "v_m_s", TRUTH, "truth"),
        ):
            axes.plot(1e3 * column(records, x), column(records, v), color=color, lw=0.7, label=label)
        if (stop_m := stop_of(traces)) is not None:
            axes.axvline(1e3 * stop_m, color=ALARM, lw=1.0, label="stop")
        axes.set(xlabel="x [mm]", ylabel="v [m/s]")
        axes.legend(loc="upper left")
        svg = svg_of(figure)
    return Plot("Phase portrait", f"The last {PORTRAIT_PERIODS} drive periods of the hold.", svg, half=True)


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
    with canvas(3.2 * len(shown), 2.6) as figure:
        all_axes = figure.subplots(1, len(shown), squeeze=False)[0]
        for axes, (values, color, label) in zip(all_axes, shown, strict=True):
            spread = float(np.ptp(values)) or max(abs(float(values[0])) * 0.02, 1e-9)
            middle = 0.5 * float(values.min() + values.max())
            half = max(spread, 0.02 * abs(middle)) * 0.55
            axes.hist(values, bins=24, range=(middle - half, middle + half), color=color)
            axes.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
            axes.set_xlabel(label)
        all_axes[0].set_ylabel("impacts")
        svg = svg_of(figure)
    return Plot(
        "Detection and impacts",
        "From touch-down to the tick that reports it; how fast, how hard.",
        svg,
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
    with canvas(3.2 * columns, 2.6) as figure:
        all_axes = list(figure.subplots(1, columns, squeeze=False)[0])
        for axes, (label, samples) in zip(all_axes, measured, strict=False):
            positive = [(sample[sample > 0.0], color, loop) for sample, color, loop in samples]
            every = np.concatenate([sample for sample, _, _ in positive])
            bins = np.geomspace(0.9 * every.min(), 1.1 * every.max(), 60).tolist()
            for sample, color, loop in positive:
                axes.hist(sample, bins=bins, histtype="step", color=color, label=loop)
            axes.set(xscale="log", yscale="log", xlabel=label, ylabel="ticks")
            axes.legend(loc="upper right")
        if whole:
            t_s, fraction = load_over_time(whole)
            all_axes[-1].plot(t_s, 100.0 * fraction, color=OTHER, lw=0.9)
            all_axes[-1].set(xlabel="simulated time [s]", ylabel="bus load [%]")
            all_axes[-1].set_ylim(bottom=0.0)
        svg = svg_of(figure)
    loops_text = f"{figures.loops.plant.overruns} and {figures.loops.firmware.overruns} ticks skipped"
    title = "Clockwork and bus" if measured else "Bus"
    caption = f"Plant and firmware: {loops_text}." if measured else "Its load."
    return Plot(title, caption, svg, half=columns == 1)


def walk(traces: RunTraces, figures: Figures) -> Plot:
    """The phases of the pulses in the gait cycle, and the error of the estimated phase."""
    window = push_off(traces.scenario)
    pulses = pulses_of(traces.plant, traces.impacts)
    with canvas(9.6, 4.2) as figure:
        figure.subplots_adjust(top=0.93)
        grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 2.0])
        histogram_axes = figure.add_subplot(grid[0, 0])
        cycle = figure.add_subplot(grid[1, 0], sharex=histogram_axes)
        felt = figure.add_subplot(grid[0, 1])
        error = figure.add_subplot(grid[1, 1], sharex=felt)
        felt.tick_params(labelbottom=False)
        for axes in (histogram_axes, cycle):
            axes.axvspan(100.0 * window.start, 100.0 * window.end, color=GOOD, alpha=0.18, lw=0.0)
        known = np.isfinite(pulses.phase)
        inside = window.holds(pulses.phase)
        held = _held(pulses.t_s, figures)
        histogram_axes.hist(
            [100.0 * pulses.phase[held & inside], 100.0 * pulses.phase[held & known & ~inside]],
            bins=np.linspace(0.0, 100.0, 41).tolist(),
            stacked=True,
            color=[GOOD, ALARM],
        )
        histogram_axes.set_ylabel("in the hold")
        histogram_axes.yaxis.set_major_locator(MaxNLocator(nbins=3, integer=True))
        histogram_axes.tick_params(labelbottom=False)
        ankle = histogram_axes.twinx()
        ankle.plot(*push_off_curve(traces.plant), color=TRUTH, lw=1.2)
        ankle.set_ylabel("ankle [N m/kg]", color=TRUTH)
        ankle.grid(visible=False)
        ankle.spines["right"].set_visible(True)
        for which, marker, color, label in (
            (inside, "o", GOOD, "pulse in the window"),
            (known & ~inside, "x", ALARM, "outside: of another turn of the stride"),
        ):
            cycle.plot(100.0 * pulses.phase[which], pulses.t_s[which], marker, color=color, ms=4, label=label)
        cycle.set(xlabel="gait cycle [%]", ylabel="simulated time [s]", xlim=(0.0, 100.0))
        cycle.set_ylim(figures.duration_s, 0.0)
        # Pulses may be anywhere in both plots: the legend stands over them.
        histogram_axes.legend(
            *cycle.get_legend_handles_labels(),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=2,
            borderaxespad=0.0,
        )
        if traces.is_worn:
            felt.plot(
                *thinned(column(traces.plant, "t_s"), column(traces.plant, "felt_force_n")),
                color=TRUTH,
                lw=0.7,
            )
            felt.set_ylabel("felt [N]")
        else:
            nothing(felt, "nobody wears the module")
        t_s, off = phase_error(traces.plant, traces.firmware)
        if len(t_s):
            error.plot(*thinned(t_s, 100.0 * off), color=ESTIMATE, lw=0.7)
        error.axhline(0.0, color=FAINT, lw=0.8)
        error.set(xlabel="simulated time [s]", ylabel="phase error [% of the cycle]")
        error.set_ylim(-15.0, 15.0)
        for axes in (felt, error):
            if figures.hold_start_s is not None and figures.hold_end_s is not None:
                axes.axvspan(figures.hold_start_s, figures.hold_end_s, color=TARGET, alpha=0.12, lw=0.0)
        if figures.gait.end_s is not None:
            for axes in (felt, error):
                axes.axvline(figures.gait.end_s, color=INK, lw=0.8, ls=":")
            cycle.axhline(figures.gait.end_s, color=INK, lw=0.8, ls=":")
        svg = svg_of(figure)
    found = figures.gait
    text = (
        "No stride was held."
        if found.in_window is None or found.outside_per_stride is None
        else f"Of {found.strides} strides {100.0 * found.in_window:.0f} % have a pulse in the window "
        f"(green), with {found.outside_per_stride:.2f} others a stride."
    )
    text += " The curve is the ankle's moment over the body's mass, which pushes off."
    ending = "" if found.end is None else f" The dotted line is the {found.end}."
    return Plot("Pulses over the gait cycle", f"{text} The hold is shaded on the right.{ending}", svg)


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
