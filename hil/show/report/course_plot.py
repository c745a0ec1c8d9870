"""The plot of a whole run: states over time, and the signals that the checks bound."""

import itertools

import numpy as np

from hil.judge.checks import checks_of
from hil.judge.figures.records import Figures
from hil.record import state_timeline
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import Lane, state_name
from hil.record.traces.stored_trace import Records
from hil.show.injected import injected
from hil.show.limits import limits
from hil.show.report.axes import DASHED, Axes, stroke
from hil.show.report.canvas import ALARM, ESTIMATE, TARGET, TRUTH, Figure, Plot, css, thinned

LEAST_NAMED = 0.08
"""A state that takes less of the run than this has no room for its name."""
BAR = np.array([[-0.4, 0.4]])
"""Above and below the middle of a state's row."""
STRIPS = ("states/mode", "states/regime")


def course(traces: RunTraces, figures: Figures) -> Plot:
    """The whole run: modes, regime and injected faults; impacts, crank speed and torque with their limits."""
    faults = injected(traces.scenario)
    bounds = limits(checks_of(traces.scenario), figures, faults[0].from_s if faults else None)
    figure = Figure("course", 920, 540)
    states, speeds, crank, torque = figure.stacked(1.0, 1.0, 1.0, 1.0)
    lanes = [lane for lane in state_timeline.FIRMWARE_LANES if lane.entity in STRIPS]
    for row, lane in enumerate(lanes):
        strip(states, row, lane, traces.firmware, figures.duration_s)
    for fault in faults:
        end_s = fault.from_s + max(
            min(fault.to_s, figures.duration_s) - fault.from_s, 0.002 * figures.duration_s
        )
        states.boxes(np.array([[fault.from_s, end_s]]), len(lanes) + BAR, ALARM)
    states.y_names = [lane.entity.removeprefix("states/") for lane in lanes] + ["injected"] * bool(faults)
    states.y.fixed = (len(states.y_names) - 0.5, -0.5)
    states.grid = False
    seen = traces.firmware[column(traces.firmware, "outputs.impact") != 0.0]
    reported_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
    speeds.points(column(traces.impacts, "t_s"), column(traces.impacts, "v_m_s"), TRUTH, "true")
    speeds.points(reported_s, column(seen, "outputs.impact_speed_m_s"), ESTIMATE, "reported", cross=True)
    speeds.y_label = "v⁻ [m/s]"
    plant_s, firmware_s = column(traces.plant, "t_s"), column(traces.firmware, "t_s")
    crank.curve(*thinned(plant_s, column(traces.plant, "omega_rad_s")), TRUTH, "true")
    target = column(traces.firmware, "outputs.target_omega_rad_s")
    crank.curve(*thinned(firmware_s, target), TARGET, "target", dash=DASHED)
    crank.y_label = "Ω [rad/s]"
    given = column(traces.plant, "motor_torque_n_m")
    torque.curve(*thinned(plant_s, given), TRUTH, "motor", width=1.0)
    asked = column(traces.firmware, "outputs.torque_n_m")
    torque.curve(*thinned(firmware_s, asked), ESTIMATE, "asked for", width=1.0)
    torque.y_label, torque.x_label = "torque [N m]", "simulated time [s]"
    plots_of = {"impact_speed": speeds, "speed": crank, "torque": torque}
    for bound in bounds:
        if (axes := plots_of.get(bound.plot)) is not None:
            look = stroke(ALARM, 1.2, DASHED)
            axes.segments((bound.from_s, bound.value), (bound.to_s, bound.value), look)
    for axes in (speeds, crank, torque):
        axes.legend = "upper left"
    if figures.latched.at_s is not None:
        for axes in (states, speeds, crank, torque):
            axes.across(figures.latched.at_s, ALARM, upright=True, width=1.3)
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
        figure.svg(),
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
        axes.boxes(np.array([[from_s, to_s]]), row + BAR, shade)
        if to_s - from_s > LEAST_NAMED * end_s:
            axes.word(from_s, row, state_name(lane.states, value), "#ffffff")
