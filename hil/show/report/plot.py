"""The plot of a report: the whole run, its states over time, and the signals that checks limit.

It is data and layout for plotly.js in the browser of the reader, who can zoom into it, and it takes
a thirtieth of the time of an image. Traces and axes are those of https://plotly.com/javascript/reference.
"""

import base64
import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hil.judge import detection
from hil.judge.checks import checks_of
from hil.judge.figures.records import Figures
from hil.record import state_timeline
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import StateTimeline, state_name
from hil.record.traces.stored_trace import Records
from hil.show.injected import Injected, injected
from hil.show.limits import limits
from plant_sim.arrays import FloatArray

Json = dict[str, Any]


def css(rgba: int) -> str:
    """One of the log's colours in CSS notation.

    >>> css(0x56B4E9FF)
    '#56b4e9'
    """
    return f"#{rgba >> 8:06x}"


TRUTH, ESTIMATE, TARGET, OTHER, ALARM, GOOD = map(css, state_timeline.PALETTE)
MOST_POINTS = 2400
"""Largest number of points of a curve: the pixels of a wide screen."""
HEIGHT_PX = 700
STRIPS = ("states/mode", "states/regime")
LEAST_SHARE = 0.002
"""Smallest width of an injected fault, as a share of the run."""
STATES, POSITION, SPEEDS, CRANK, TORQUE = "y", "y2", "y3", "y4", "y5"
"""Plotly's names of the panels' axes, from above; all have one time axis."""
PANELS = {
    STATES: ("", (0.88, 1.0)),
    POSITION: ("x [mm]", (0.58, 0.85)),
    SPEEDS: ("v⁻ [m/s]", (0.39, 0.55)),
    CRANK: ("Ω [rad/s]", (0.19, 0.36)),
    TORQUE: ("torque [N m]", (0.0, 0.16)),
}
"""Title of each panel, and its place as shares of the height from below."""
PANEL_OF = {"impact_speed": SPEEDS, "speed": CRANK, "torque": TORQUE}
"""The panels in which limits of checks are drawn."""


class Plot(NamedTuple):
    """A chart with its title and caption."""

    title: str
    caption: str
    chart: Json


def thinned(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At most `MOST_POINTS` rows with the extremes of `values`; both of shape (n,)."""
    blocks = MOST_POINTS // 2
    if len(t) <= MOST_POINTS:
        return t, values
    length = -(-len(t) // blocks)
    padded = np.pad(values, (0, blocks * length - len(t)), mode="edge").reshape(blocks, length)
    starts = length * np.arange(blocks)
    extremes = np.concatenate([starts + padded.argmin(axis=1), starts + padded.argmax(axis=1)])
    rows = np.unique(np.minimum(extremes, len(t) - 1))
    return t[rows], values[rows]


def numbers(values: ArrayLike, kind: str) -> Json:
    """Values in Plotly's binary format, in single precision (`f4`) or double precision (`f8`)."""
    data = np.asarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(data.tobytes()).decode()}


def line(
    panel: str,
    name: str,
    t_s: ArrayLike,
    values: ArrayLike,
    color: str,
    dash: str = "solid",
    width: float = 1.2,
) -> Json:
    """A line in a panel."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": numbers(t_s, "f8"),
        "y": numbers(values, "f4"),
        "yaxis": panel,
        "line": {"color": color, "width": width, "dash": dash},
    }


def curve(panel: str, name: str, records: Records, signal: str, color: str, dash: str = "solid") -> Json:
    """A signal of a trace; a position in millimetres."""
    scale = 1e3 if panel == POSITION else 1.0
    return line(panel, name, *thinned(column(records, "t_s"), scale * column(records, signal)), color, dash)


def points(name: str, t_s: FloatArray, v_m_s: FloatArray, color: str, symbol: str) -> Json:
    """The approach speeds of impacts."""
    marker = {"color": color, "size": 6, "symbol": symbol}
    return line(SPEEDS, name, *thinned(t_s, v_m_s), color) | {"mode": "markers", "marker": marker}


def bars(row: str, spans: list[tuple[float, float]], names: list[str], shades: list[str]) -> Json:
    """A row of the states' panel: a bar for each interval in s, with its name if there is room."""
    return {
        "type": "bar",
        "orientation": "h",
        "showlegend": False,
        "y": [row] * len(spans),
        "base": [from_s for from_s, _ in spans],
        "x": [to_s - from_s for from_s, to_s in spans],
        "text": names,
        "textposition": "inside",
        "insidetextanchor": "start",
        "textangle": 0,
        "hovertemplate": "%{text}<br>%{base:.3f} s, for %{value:.3f} s<extra></extra>",
        "marker": {"color": shades},
        "yaxis": STATES,
    }


def fault_strip(faults: list[Injected], end_s: float) -> Json:
    """The injected faults as a row of bars."""
    least_s = LEAST_SHARE * end_s
    spans = [(one.from_s, max(min(one.to_s, end_s), one.from_s + least_s)) for one in faults]
    return bars("injected", spans, [fault.text for fault in faults], [ALARM] * len(faults))


def strip(timeline: StateTimeline, records: Records, end_s: float) -> Json:
    """A state timeline as a row of bars."""
    values, t_s = column(records, timeline.column).astype(int), column(records, "t_s")
    starts = np.flatnonzero(np.diff(values, prepend=-1))
    states = values[starts].tolist()
    colors = {state.value: css(color) for state, color in timeline.colors.items()}
    return bars(
        timeline.entity.removeprefix("states/"),
        list(itertools.pairwise([*t_s[starts].tolist(), end_s])),
        [state_name(timeline.states, value) for value in states],
        [colors.get(value, ALARM) for value in states],
    )


def drawn(traces: RunTraces, figures: Figures, faults: list[Injected]) -> Iterator[Json]:
    """Everything that the plot shows."""
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    end_s = figures.duration_s
    for timeline in state_timeline.FIRMWARE_TIMELINES:
        if timeline.entity in STRIPS:
            yield strip(timeline, firmware, end_s)
    if faults:
        yield fault_strip(faults, end_s)
    yield curve(POSITION, "true position", plant, "x_m", TRUTH)
    stop_m = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    if stop_m is not None:
        yield line(POSITION, "stop", [0.0, end_s], [1e3 * stop_m] * 2, ALARM, width=2.0)
    yield points("true impact", column(impacts, "t_s"), column(impacts, "v_m_s"), TRUTH, "circle")
    seen = detection.reported(firmware)
    reported_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
    yield points("reported impact", reported_s, column(seen, "outputs.impact_speed_m_s"), ESTIMATE, "x")
    yield curve(CRANK, "true speed", plant, "omega_rad_s", TRUTH)
    yield curve(CRANK, "target speed", firmware, "outputs.target_omega_rad_s", TARGET, "dot")
    yield curve(TORQUE, "motor torque", plant, "motor_torque_n_m", TRUTH)
    yield curve(TORQUE, "commanded torque", firmware, "outputs.torque_n_m", ESTIMATE)
    for limit in limits(checks_of(traces.scenario), figures, faults[0].from_s if faults else None):
        if (panel := PANEL_OF.get(limit.plot)) is not None:
            span_s = [limit.from_s, limit.to_s]
            bound = line(panel, limit.name, span_s, [limit.value] * 2, ALARM, "dash", width=2.0)
            yield bound | {"showlegend": False}


def plot(traces: RunTraces, figures: Figures) -> Plot:
    """The whole run: modes, regime, injected faults; position, impacts, crank speed, torque; limits."""
    faults = injected(traces.scenario)
    latched_s = figures.latched.at_s
    caption = f"{figures.impact_count} touch-downs. Dashed: limits of checks."
    if faults:
        caption += f" Injected: {'; '.join(f'{fault.text} at {fault.from_s:g} s' for fault in faults)}."
    upright: list[Json] = []
    if latched_s is not None:
        caption += f" The line across is the fault {figures.fault}, latched at {latched_s:.3f} s."
        ends = {"x0": latched_s, "x1": latched_s, "y0": 0.0, "y1": 1.0}
        upright = [{"type": "line", "yref": "paper", "line": {"color": ALARM, "width": 1}, **ends}]
    plain: Json = {"zeroline": False, "gridcolor": "rgba(128, 134, 143, 0.25)"}
    axes: Json = {
        f"yaxis{name[1:]}": {**plain, "title": {"text": title}, "domain": place}
        for name, (title, place) in PANELS.items()
    }
    axes["yaxis"] |= {"autorange": "reversed", "showgrid": False}
    layout = {
        "height": HEIGHT_PX,
        "margin": {"l": 62, "r": 12, "t": 60, "b": 44},
        "font": {"family": "system-ui, sans-serif", "size": 12},
        "legend": {"orientation": "h", "x": 0.0, "y": 1.01, "yanchor": "bottom"},
        "paper_bgcolor": "rgba(0, 0, 0, 0)",
        "plot_bgcolor": "rgba(0, 0, 0, 0)",
        "modebar": {"bgcolor": "rgba(0, 0, 0, 0)"},
        "hovermode": "closest",
        "barmode": "overlay",
        "uniformtext": {"minsize": 9, "mode": "hide"},
        "shapes": upright,
        "xaxis": {**plain, "title": {"text": "simulated time [s]"}, "anchor": TORQUE},
        **axes,
    }
    return Plot("The run", caption, {"data": list(drawn(traces, figures, faults)), "layout": layout})
