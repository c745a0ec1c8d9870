"""The plot of a whole run: states over time, and the signals that the checks bound."""

import itertools

import numpy as np
from matplotlib.axes import Axes

from hil.judge.checks import checks_of
from hil.judge.figures.records import Figures
from hil.record import state_timeline
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import Lane, state_name
from hil.record.traces.stored_trace import Records
from hil.show.injected import injected
from hil.show.limits import limits
from hil.show.report.canvas import ALARM, ESTIMATE, TARGET, TRUTH, Plot, canvas, css, svg_of, thinned

LEAST_NAMED = 0.08
"""A state that takes less of the run than this has no room for its name."""
STRIPS = ("states/mode", "states/regime")


def course(traces: RunTraces, figures: Figures) -> Plot:
    """The whole run: modes, regime and injected faults; impacts, crank speed and torque with their limits."""
    faults = injected(traces.scenario)
    bounds = limits(checks_of(traces.scenario), figures, faults[0].from_s if faults else None)
    with canvas(9.6, 5.6) as figure:
        states, speeds, crank, torque = figure.subplots(4, 1, sharex=True)
        rows = [lane for lane in state_timeline.FIRMWARE_LANES if lane.entity in STRIPS]
        for row, lane in enumerate(rows):
            strip(states, row, lane, traces.firmware, figures.duration_s)
        for fault in faults:
            width_s = max(min(fault.to_s, figures.duration_s) - fault.from_s, 0.002 * figures.duration_s)
            states.broken_barh([(fault.from_s, width_s)], (len(rows) - 0.4, 0.8), color=ALARM)
        names = [lane.entity.removeprefix("states/") for lane in rows] + ["injected"] * bool(faults)
        states.set_yticks(range(len(names)), names)
        states.invert_yaxis()
        states.grid(visible=False)
        seen = traces.firmware[column(traces.firmware, "outputs.impact") != 0.0]
        reported_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
        touched_s = column(traces.impacts, "t_s")
        speeds.plot(touched_s, column(traces.impacts, "v_m_s"), "o", color=TRUTH, ms=4, label="true")
        reported = column(seen, "outputs.impact_speed_m_s")
        speeds.plot(reported_s, reported, "x", color=ESTIMATE, ms=4, label="reported")
        speeds.set(ylabel="v⁻ [m/s]")
        plant_s, firmware_s = column(traces.plant, "t_s"), column(traces.firmware, "t_s")
        crank.plot(*thinned(plant_s, column(traces.plant, "omega_rad_s")), color=TRUTH, lw=0.9, label="true")
        target = column(traces.firmware, "outputs.target_omega_rad_s")
        crank.plot(*thinned(firmware_s, target), color=TARGET, ls="--", lw=0.9, label="target")
        crank.set(ylabel="Ω [rad/s]")
        given = column(traces.plant, "motor_torque_n_m")
        torque.plot(*thinned(plant_s, given), color=TRUTH, lw=0.7, label="motor")
        asked = column(traces.firmware, "outputs.torque_n_m")
        torque.plot(*thinned(firmware_s, asked), color=ESTIMATE, lw=0.7, label="asked for")
        torque.set(ylabel="torque [N m]", xlabel="simulated time [s]")
        plots_of = {"impact_speed": speeds, "speed": crank, "torque": torque}
        for bound in bounds:
            if (axes := plots_of.get(bound.plot)) is not None:
                axes.hlines(bound.value, bound.from_s, bound.to_s, color=ALARM, lw=0.9, ls="--")
        for axes in (speeds, crank, torque):
            axes.legend(loc="upper left", ncols=2)
        if figures.latched.at_s is not None:
            for axes in (states, speeds, crank, torque):
                axes.axvline(figures.latched.at_s, color=ALARM, lw=1.0)
        svg = svg_of(figure)
    latched = (
        ""
        if figures.latched.at_s is None
        else f" The line across is the fault {figures.fault}, latched at {figures.latched.at_s:.3f} s."
    )
    injected_text = "; ".join(f"{fault.text} at {fault.from_s:g} s" for fault in faults)
    return Plot(
        "The run",
        f"{figures.impact_count} touch-downs. Dashed: limits of checks."
        + (f" Injected: {injected_text}." if faults else "")
        + latched,
        svg,
    )


def strip(axes: Axes, row: int, lane: Lane, records: Records, end_s: float) -> None:
    """A state timeline as a row of bars with their names where they are wide enough."""
    values, t_s = column(records, lane.column).astype(int), column(records, "t_s")
    if len(values) == 0:
        return
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    edges_s = [*t_s[starts].tolist(), end_s]
    for at, (from_s, to_s) in zip(starts, itertools.pairwise(edges_s), strict=True):
        value = int(values[at])
        known = [state for state in lane.states if state.value == value]
        shade = css(lane.colors.get(known[0], state_timeline.ALARM) if known else state_timeline.ALARM)
        axes.broken_barh([(from_s, to_s - from_s)], (row - 0.4, 0.8), color=shade)
        if to_s - from_s > LEAST_NAMED * end_s:
            name = state_name(lane.states, value)
            axes.text(from_s, row, f" {name}", va="center", fontsize=8.0, color="#ffffff", clip_on=True)
