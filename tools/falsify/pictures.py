"""Pictures of a search: a run around its instant, and margins over the two keys that matter most."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.figures.detection import select_reported
from hil.figures.moments import moment_of
from hil.figures.records import CATALOGUE, Origin
from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces, column, pair_by_tick
from plant_sim.arrays import FloatArray
from tools.falsify.evaluations import Evaluations
from tools.falsify.objective import judged
from tools.falsify.search import Best, most_important
from tools.falsify.space import Dimension, Space
from tools.plots import drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AROUND_S = 1.0
"""Time shown before and after the first fault, or else the instant that explains the check."""
DETECTOR = "detector."
"""Beginning of the figures that compare the reported impacts with the true ones."""
MEET_S = 0.1
"""Faults that begin within this time have one label."""
SIGNALS = {
    DETECTOR: ("v_m_s", "velocity [m/s]"),
    "speed": ("omega_rad_s", "crank speed [rad/s]"),
    "largest_speed": ("omega_rad_s", "crank speed [rad/s]"),
    "turning": ("omega_rad_s", "crank speed [rad/s]"),
    "torque": ("motor_torque_n_m", "motor torque [N m]"),
    "force": ("stop_force_n", "force on the stop [N]"),
    "felt": ("felt_force_n", "felt force [N]"),
    "estimate": ("", "error of the estimate [mm]"),
}
"""The plant's signal behind a figure, by a word of its name; otherwise the striker's velocity."""


def signal_of(name: str, traces: RunTraces) -> tuple[FloatArray, FloatArray, str]:
    """Times, values and label of the signal behind a figure."""
    signal, label = next((one for word, one in SIGNALS.items() if word in name), ("v_m_s", "velocity [m/s]"))
    if signal:
        return column(traces.plant, "t_s"), column(traces.plant, signal), label
    plant, firmware = pair_by_tick(traces.plant, traces.firmware)
    error_m = column(firmware, "state.estimator.x_m") - column(plant, "x_m")
    return column(plant, "t_s"), 1e3 * error_m, label


def draw_reports(traces: RunTraces, from_s: float, to_s: float, axes: "Axes") -> None:
    """Draw the approach speeds of the true impacts and of the reported ones, in an interval."""
    reports = select_reported(traces.firmware)
    shown = ((traces.impacts, "v_m_s", "o", "impact"), (reports, "outputs.impact_speed_m_s", "x", "report"))
    for records, name, mark, label in shown:
        t_s = column(records, "t_s")
        at = (from_s <= t_s) & (t_s <= to_s)
        axes.plot(t_s[at], column(records, name)[at], mark, ms=5, mfc="none", label=label)
    axes.legend(fontsize=7, loc="lower right")


def draw_instant(best: Best, axes: "Axes") -> None:
    """Draw the signal behind the worst check around its instant, with the script's faults."""
    scenario = best.space.scenario(best.values)
    check = scenario.checks[best.space.chosen[best.check]]
    verdict, traces = judged(scenario, [check])
    faults = faults_of(traces.run)
    moment_s = moment_of(check.name, traces, verdict.figures)
    of_hold = check.name in CATALOGUE and CATALOGUE[check.name].origin is Origin.HOLD
    at_s = min((one.from_s for one in faults), default=moment_s - AROUND_S if of_hold else moment_s)
    if check.name.startswith(DETECTOR):
        at_s = moment_s
    t_s, values, label = signal_of(check.name, traces)
    shown = np.abs(t_s - at_s) <= AROUND_S
    axes.plot(t_s[shown], values[shown], lw=1.0)
    if check.name.startswith(DETECTOR):
        draw_reports(traces, at_s - AROUND_S, at_s + AROUND_S, axes)
    near = sorted((one for one in faults if abs(one.from_s - at_s) <= AROUND_S), key=lambda one: one.from_s)
    labelled_s, across = -np.inf, axes.get_xaxis_transform()
    for fault in near:
        axes.axvline(fault.from_s, color="tab:red", lw=0.8, ls="--")
        if fault.from_s - labelled_s > MEET_S:
            labelled_s = fault.from_s
            more = sum(0.0 <= one.from_s - labelled_s <= MEET_S for one in near) - 1
            words = f"{fault.kind} + {more} faults" if more else fault.kind
            axes.text(labelled_s, 1.0, words, transform=across, rotation=90, size=6, va="top", ha="right")
    axes.set(xlabel="time [s]", ylabel=label)
    axes.set_title(f"{check.name}, margin {best.margin:.0%}\n{best.space.name}", fontsize=8)


def plot_instant(best: Best, path: Path) -> None:
    """Draw a run around its instant into a file."""
    with drawn(path, 9.0, 3.6) as figure:
        draw_instant(best, figure.subplots())


def number_of(dimension: Dimension, value: Any) -> float:
    """A value as a number; of texts the place among the choices."""
    return float(value if isinstance(value, int | float) else dimension.choices.index(value))


def plot_margins(best: Best, evaluations: Evaluations, path: Path) -> bool:
    """Draw the worst check's margins in all judged runs of its scenario over the two most important keys.

    Return False, without a file, if no margin differs from another.
    """
    space: Space = best.space
    rows = [
        (values, result.margins[best.check])
        for (name, values), result in evaluations.known.items()
        if name == space.name and not result.why and result.margins[best.check] is not None
    ]
    margins = np.array([margin for _, margin in rows])
    if len(np.unique(margins)) < 2:
        return False
    places = np.array([list(map(number_of, space.dimensions, values)) for values, _ in rows])
    keys = most_important(places, margins)
    with drawn(path, 7.0, 4.6) as figure:
        axes = figure.subplots()
        if len(keys) == 2:
            shown = axes.scatter(places[:, keys[0]], places[:, keys[1]], c=margins, s=14, cmap="viridis")
            figure.colorbar(shown, label=f"margin of {best.name}")
            least = places[int(np.argmin(margins))]
            axes.plot(*least[keys], "r+", ms=14, mew=2, label="smallest margin")
            axes.legend(loc="upper right")
            axes.set(xlabel=space.dimensions[keys[0]].key, ylabel=space.dimensions[keys[1]].key)
        else:
            axes.plot(places[:, keys[0]], margins, ".")
            axes.set(xlabel=space.dimensions[keys[0]].key, ylabel=f"margin of {best.name}")
        axes.set_title(f"{space.name}: {len(margins)} runs, smallest margin {best.margin:.0%}", fontsize=8)
    return True
