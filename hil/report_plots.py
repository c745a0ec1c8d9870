"""The plots of a report: each explains a part of the verdict. Inline SVG that follows the page's colours."""

import io
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from hil import detection
from hil.bus_figures import LOAD_BIN_S, bits_on_the_bus, load_by_bin, load_over_time
from hil.figure_records import Figures
from hil.gait_figures import phase_error, pulses_of, push_off
from hil.run_traces import Records, RunTraces, column

FloatArray = NDArray[np.float64]

TRUTH, ESTIMATE, TARGET, ALARM, OTHER = "#3f8fe0", "#e8912d", "#8e8e96", "#e5484d", "#4fa65b"
"""The colours of the log: the plant's truth, the firmware's estimate, the request, alarms, the rest."""
INK, FAINT = "#010203", "#040506"
"""Stand-ins for the page's own colours, which differ in the dark."""
MOST_POINTS = 2400
"""A curve has no more points than a wide screen has pixels to show them."""
PORTRAIT_PERIODS = 12
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "vibrohil",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.alpha": 0.25,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "path.simplify_threshold": 0.5,
}


class Plot(NamedTuple):
    """A drawing with the sentence that says what it shows."""

    title: str
    caption: str
    svg: str
    half: bool = False
    """Whether two of its kind stand side by side."""


def thinned(t: FloatArray, *values: FloatArray) -> tuple[FloatArray, ...]:
    """Rows of at most `MOST_POINTS`, the extremes of the first of `values` among them; all of shape (n,)."""
    if len(t) <= MOST_POINTS:
        return (t, *values)
    edges = np.linspace(0, len(t), MOST_POINTS // 2 + 1).astype(int)
    rows: list[int] = []
    for low, high in itertools.pairwise(edges.tolist()):
        block = values[0][low:high]
        rows += sorted({low + int(np.argmin(block)), low + int(np.argmax(block))})
    return (t[rows], *(value[rows] for value in values))


@contextmanager
def canvas(width: float, height: float) -> Iterator[Figure]:
    """An empty figure in the report's style, sizes in inches at 96 pixels."""
    with mpl.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


def svg_of(figure: Figure) -> str:
    """The figure as an SVG element whose colours follow the page."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    return text.replace(INK, "var(--ink)").replace(FAINT, "var(--faint)").strip()


def nothing(axes: Axes, text: str) -> None:
    """Say on an empty plot why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=INK)
    axes.set_axis_off()


def within(records: Records, start_s: float, end_s: float) -> Records:
    """The records of a stretch of time."""
    t_s = column(records, "t_s")
    return records[(t_s >= start_s) & (t_s <= end_s)]


def stop_of(traces: RunTraces) -> float | None:
    """Where the stop is, in metres."""
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
        speed.vlines(column(touched, "t_s"), 0.0, column(touched, "v_m_s"), color=ALARM, lw=0.8)
        speed.plot(column(touched, "t_s"), column(touched, "v_m_s"), ".", color=ALARM, ms=4)
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
                axes.axvline(figures.capture_s, color=OTHER, lw=0.8, ls=":")
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
    """When the run-up is worth looking at."""
    moving = np.flatnonzero(column(traces.firmware, "outputs.target_omega_rad_s") > 0.0)
    start_s = float(column(traces.firmware, "t_s")[moving[0]]) if len(moving) else 0.0
    end_s = figures.duration_s if figures.hold_start_s is None else figures.hold_start_s + 2.0
    return start_s, min(end_s, figures.duration_s)


def portrait(traces: RunTraces, figures: Figures) -> Plot:
    """The orbit at the end of the hold, true and estimated."""
    with canvas(4.7, 3.6) as figure:
        axes = figure.subplots()
        if figures.hold_start_s is None or figures.hold_end_s is None or figures.speed.mean_rad_s is None:
            nothing(axes, "no hold to show")
        else:
            span_s = PORTRAIT_PERIODS * 2.0 * np.pi / abs(figures.speed.mean_rad_s)
            start_s = max(figures.hold_start_s, figures.hold_end_s - span_s)
            estimated = within(traces.firmware, start_s, figures.hold_end_s)
            truth = within(traces.plant, start_s, figures.hold_end_s)
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


def impact_speeds(traces: RunTraces, figures: Figures) -> Plot:
    """Approach speeds over the run, true and as the firmware reported them."""
    seen = traces.firmware[column(traces.firmware, "outputs.impact") != 0.0]
    reported_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
    with canvas(4.7, 3.6) as figure:
        axes = figure.subplots()
        if len(traces.impacts) == 0:
            nothing(axes, "no impact in this run")
        else:
            axes.plot(
                column(traces.impacts, "t_s"),
                column(traces.impacts, "v_m_s"),
                "o",
                color=TRUTH,
                ms=4,
                label="true",
            )
            axes.plot(
                reported_s,
                column(seen, "outputs.impact_speed_m_s"),
                "x",
                color=ESTIMATE,
                ms=4,
                label="reported",
            )
            axes.set(xlabel="simulated time [s]", ylabel="v⁻ [m/s]")
            axes.set_ylim(bottom=0.0)
            axes.legend(loc="lower right")
        svg = svg_of(figure)
    return Plot("Impact speed", f"{figures.impact_count} touch-downs in the run.", svg, half=True)


def histogram(axes: Axes, values: FloatArray, color: str, label: str, empty: str) -> None:
    """Counts of `values`, or why there are none."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        nothing(axes, empty)
        return
    spread = float(np.ptp(finite)) or max(abs(float(finite[0])) * 0.02, 1e-9)
    middle = 0.5 * float(finite.min() + finite.max())
    half = max(spread, 0.02 * abs(middle)) * 0.55
    axes.hist(finite, bins=24, range=(middle - half, middle + half), color=color)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    axes.set_xlabel(label)


def distributions(traces: RunTraces, _: Figures) -> Plot:
    """Detection latency, approach speed and peak force."""
    seen = traces.firmware[column(traces.firmware, "outputs.impact") != 0.0]
    pairs = detection.match(column(traces.impacts, "t_s"), column(seen, "t_s"))
    latency_ms = 1e3 * (column(seen, "t_s")[pairs.detection] - column(traces.impacts, "t_s")[pairs.truth])
    with canvas(9.6, 2.6) as figure:
        left, middle, right = figure.subplots(1, 3)
        histogram(left, latency_ms, ESTIMATE, "detection latency [ms]", "nothing detected")
        histogram(middle, column(traces.impacts, "v_m_s"), TRUTH, "v⁻ [m/s]", "no impact")
        without_force = "a rigid stop has none" if len(traces.impacts) else "no impact"
        histogram(right, column(traces.impacts, "peak_force_n"), ALARM, "peak force [N]", without_force)
        left.set_ylabel("impacts")
        svg = svg_of(figure)
    return Plot(
        "Detection and impacts", "From touch-down to the tick that reports it; how fast, how hard.", svg
    )


def timing(traces: RunTraces, figures: Figures) -> Plot:
    """Work and wake-up latency of both loops, and the bus."""
    with canvas(9.6, 2.6) as figure:
        work, wake, load = figure.subplots(1, 3)
        for axes, name, label in (
            (work, "work_us", "work [µs]"),
            (wake, "wake_latency_us", "wake-up latency [µs]"),
        ):
            loops = [(traces.plant, TRUTH, "plant"), (traces.firmware, ESTIMATE, "firmware")]
            samples = [column(records, name) for records, _, _ in loops]
            largest = max((float(sample.max()) for sample in samples if len(sample)), default=0.0)
            if largest <= 0.0:
                nothing(axes, "not measured in lockstep")
                continue
            smallest = min(float(sample[sample > 0.0].min()) for sample in samples if (sample > 0.0).any())
            bins = np.geomspace(0.9 * smallest, 1.1 * largest, 60).tolist()
            for sample, (_, color, loop) in zip(samples, loops, strict=True):
                if (sample > 0.0).any():
                    axes.hist(sample, bins=bins, histtype="step", color=color, label=loop)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel(label)
            axes.legend(loc="upper right")
        work.set_ylabel("ticks")
        bits = load_by_bin(traces.bus.t_s, bits_on_the_bus(traces.bus.length))
        whole = {n: sent for n, sent in bits.items() if (n + 1) * LOAD_BIN_S <= figures.duration_s}
        if whole:
            t_s, fraction = load_over_time(whole)
            load.plot(t_s, 100.0 * fraction, color=OTHER, lw=0.9)
            load.set(xlabel="simulated time [s]", ylabel="bus load [%]")
            load.set_ylim(bottom=0.0)
        else:
            nothing(load, "no can.log")
        svg = svg_of(figure)
    loops_text = f"{figures.loops.plant.overruns} and {figures.loops.firmware.overruns} ticks skipped"
    return Plot("Clockwork and bus", f"Plant and firmware: {loops_text}.", svg)


def walk(traces: RunTraces, figures: Figures) -> Plot:
    """Where in the gait cycle the pulses come, and how far off the estimated phase is."""
    window = push_off(traces.scenario)
    pulses = pulses_of(traces.plant, traces.impacts)
    with canvas(9.6, 4.2) as figure:
        grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 2.0])
        histogram_axes = figure.add_subplot(grid[0, 0])
        cycle = figure.add_subplot(grid[1, 0], sharex=histogram_axes)
        felt = figure.add_subplot(grid[0, 1])
        error = figure.add_subplot(grid[1, 1], sharex=felt)
        for axes in (histogram_axes, cycle):
            axes.axvspan(100.0 * window.start, 100.0 * window.end, color=OTHER, alpha=0.18, lw=0.0)
        known = np.isfinite(pulses.phase)
        inside = window.holds(pulses.phase)
        held = _held(pulses.t_s, figures)
        histogram_axes.hist(
            [100.0 * pulses.phase[held & inside], 100.0 * pulses.phase[held & known & ~inside]],
            bins=np.linspace(0.0, 100.0, 41).tolist(),
            stacked=True,
            color=[OTHER, ALARM],
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
            (inside, "o", OTHER, "pulse in the window"),
            (known & ~inside, "x", ALARM, "outside"),
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


def _held(t_s: FloatArray, figures: Figures) -> NDArray[np.bool_]:
    """Which times lie within the hold."""
    if figures.hold_start_s is None or figures.hold_end_s is None:
        return np.zeros(len(t_s), bool)
    return (t_s >= figures.hold_start_s) & (t_s <= figures.hold_end_s)


PLOTS: tuple[Callable[[RunTraces, Figures], Plot], ...] = (
    start_up,
    portrait,
    impact_speeds,
    distributions,
    timing,
)


def plots(traces: RunTraces, figures: Figures) -> list[Plot]:
    """All plots of a report, in order; that of the gait where somebody walks."""
    walked = traces.is_walked and len(traces.plant) > 0 and len(traces.firmware) > 0
    return [draw(traces, figures) for draw in (PLOTS[0], *([walk] if walked else []), *PLOTS[1:])]
