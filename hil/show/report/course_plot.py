"""The plot of a whole run: states over time, and the signals bounded by checks."""

import itertools

import numpy as np

from hil.judge import detection
from hil.judge.checks import checks_of
from hil.judge.figures.records import Figures
from hil.record import state_timeline
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import StateTimeline, state_name
from hil.record.traces.stored_trace import Records
from hil.show.injected import Injected, injected
from hil.show.limits import limits
from hil.show.report import chart

STRIPS = ("states/mode", "states/regime")
LEAST_SHARE = 0.002
"""Smallest width of an injected fault, as a share of the run."""
STATES, POSITION, SPEEDS, CRANK, TORQUE = range(1, 6)
PANEL_OF = {"impact_speed": SPEEDS, "speed": CRANK, "torque": TORQUE}


def stop_of(traces: RunTraces) -> float | None:
    """The stop's position, in m."""
    position = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    return None if position is None else float(position)


def course(traces: RunTraces, figures: Figures) -> chart.Plot:
    """The whole run: modes, regime, injected faults; position, impacts, crank speed, torque; limits."""
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    faults = injected(traces.scenario)
    seen = detection.reported(firmware)
    reported_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
    reported_m_s = column(seen, "outputs.impact_speed_m_s")
    plant_s, firmware_s = column(plant, "t_s"), column(firmware, "t_s")
    target_rad_s = column(firmware, "outputs.target_omega_rad_s")
    commanded_n_m = column(firmware, "outputs.torque_n_m")
    timelines = [timeline for timeline in state_timeline.FIRMWARE_TIMELINES if timeline.entity in STRIPS]
    drawn = [
        *(strip(timeline, firmware, figures.duration_s) for timeline in timelines),
        *([fault_strip(faults, figures.duration_s)] if faults else []),
        chart.curve(POSITION, "true position", plant_s, 1e3 * column(plant, "x_m"), chart.TRUTH),
        chart.points(SPEEDS, "true impact", column(impacts, "t_s"), column(impacts, "v_m_s"), chart.TRUTH),
        chart.points(SPEEDS, "reported impact", reported_s, reported_m_s, chart.ESTIMATE, "x"),
        chart.curve(CRANK, "true speed", plant_s, column(plant, "omega_rad_s"), chart.TRUTH),
        chart.curve(CRANK, "target speed", firmware_s, target_rad_s, chart.TARGET, dash="dot"),
        chart.curve(TORQUE, "motor torque", plant_s, column(plant, "motor_torque_n_m"), chart.TRUTH),
        chart.curve(TORQUE, "commanded torque", firmware_s, commanded_n_m, chart.ESTIMATE),
    ]
    if (stop_m := stop_of(traces)) is not None:
        drawn.append(chart.level(POSITION, "stop", 1e3 * stop_m, 0.0, figures.duration_s, chart.ALARM))
    for bound in limits(checks_of(traces.scenario), figures, faults[0].from_s if faults else None):
        if (panel := PANEL_OF.get(bound.plot)) is not None:
            drawn.append(
                chart.level(panel, bound.name, bound.value, bound.from_s, bound.to_s, chart.ALARM, "dash")
            )
    latched_s = figures.latched.at_s
    panels = chart.stacked(
        [("", 0.8), ("x [mm]", 1.6), ("v⁻ [m/s]", 1.0), ("Ω [rad/s]", 1.0), ("torque [N m]", 1.0)],
        "simulated time [s]",
    )
    panels[0] = panels[0]._replace(y_axis={"autorange": "reversed", "showgrid": False})
    content = chart.chart(
        700,
        panels,
        drawn,
        [] if latched_s is None else [chart.upright(TORQUE, latched_s, chart.ALARM, "solid")],
        barmode="overlay",
        uniformtext={"minsize": 9, "mode": "hide"},
    )
    latched = (
        ""
        if latched_s is None
        else f" The line across is the fault {figures.fault}, latched at {latched_s:.3f} s."
    )
    injected_text = "; ".join(f"{fault.text} at {fault.from_s:g} s" for fault in faults)
    return chart.Plot(
        "The run",
        f"{figures.impact_count} touch-downs. Dashed: limits of checks."
        + (f" Injected: {injected_text}." if faults else "")
        + latched,
        content,
    )


def bars(timeline: str, spans: list[tuple[float, float]], names: list[str], shades: list[str]) -> chart.Json:
    """A row of the states' panel: a bar for each interval in s, with its name if there is room."""
    return {
        "type": "bar",
        "orientation": "h",
        "showlegend": False,
        "y": [timeline] * len(spans),
        "base": [from_s for from_s, _ in spans],
        "x": [to_s - from_s for from_s, to_s in spans],
        "text": names,
        "textposition": "inside",
        "insidetextanchor": "start",
        "textangle": 0,
        "hovertemplate": "%{text}<br>%{base:.3f} s, for %{value:.3f} s<extra></extra>",
        "marker": {"color": shades},
        **chart.on(STATES),
    }


def fault_strip(faults: list[Injected], end_s: float) -> chart.Json:
    """The injected faults as a row of bars."""
    least_s = LEAST_SHARE * end_s
    spans = [(one.from_s, max(min(one.to_s, end_s), one.from_s + least_s)) for one in faults]
    return bars("injected", spans, [fault.text for fault in faults], [chart.ALARM] * len(faults))


def strip(timeline: StateTimeline, records: Records, end_s: float) -> chart.Json:
    """A state timeline as a row of bars."""
    values, t_s = column(records, timeline.column).astype(int), column(records, "t_s")
    starts = np.flatnonzero(np.diff(values, prepend=-1))
    states = values[starts].tolist()
    known = [next((state for state in timeline.states if state.value == value), None) for value in states]
    alarm = state_timeline.ALARM
    shades = [chart.css(alarm if state is None else timeline.colors.get(state, alarm)) for state in known]
    return bars(
        timeline.entity.removeprefix("states/"),
        list(itertools.pairwise([*t_s[starts].tolist(), end_s])),
        [state_name(timeline.states, value) for value in states],
        shades,
    )
