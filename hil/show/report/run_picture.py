"""The pictures of a run's report: the whole run, and a close-up of its cause."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hil.judge.why.cause import AFTER_S, BEFORE_S, Cause
from hil.record.rrd.rates import SIGNAL
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import ALARM, FIRMWARE_TIMELINES, StateTimeline, state_name
from hil.record.traces.stored_trace import Records
from hil.scenario.checks import Check, checks_of
from hil.show.injected import injected_in
from hil.show.report.picture import Curve, Level, Picture, Plot, Span, Strip
from plant_sim.arrays import FloatArray

STRIPS = {"states/mode": "mode", "states/regime": "regime"}
"""The state timelines above the plots, by their entities, with their names in the margin."""


class Judged(NamedTuple):
    """A signal that shows a figure of a check, and the title of its plot."""

    signal: str
    title: str


SHOWN_BY: Mapping[str, Judged] = {
    "peak_force_n": Judged("plant.stop_force_n", "Force on the stop [N]"),
    "after_fault.peak_force_n": Judged("plant.stop_force_n", "Force on the stop [N]"),
    "felt.peak_n": Judged("plant.felt_force_n", "Force on the wearer [N]"),
    "after_fault.largest_torque_n_m": Judged("plant.motor_torque_n_m", "Torque of the motor [N m]"),
    "motor_torque_after_stop_n_m": Judged("plant.motor_torque_n_m", "Torque of the motor [N m]"),
    "after_fault.largest_speed_rad_s": Judged("plant.omega_rad_s", "Crank speed [rad/s]"),
    "speed.mean_rad_s": Judged("plant.omega_rad_s", "Crank speed [rad/s]"),
}
"""Figures that are a value of one signal, which can have the check's limits beside it."""
EXTREME = re.compile(r"(?:max|min)\((?:abs\()?(?:firmware|plant)\.[\w.]+\)+")
"""An own figure that is the extreme of one signal."""


def state_strip(timeline: StateTimeline, title: str, firmware: Records) -> Strip:
    """A state of the firmware over the whole run."""
    t_s, values = column(firmware, "t_s"), column(firmware, timeline.column).astype(np.int64)
    at = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    ends_s = np.append(t_s[at[1:]], t_s[-1])
    by_value = {int(state): rgba for state, rgba in timeline.colors.items()}
    return Strip(
        title,
        [
            Span(float(from_s), float(to_s), state_name(timeline.states, value), by_value.get(value, ALARM))
            for from_s, to_s, value in zip(t_s[at], ends_s, values[at].tolist(), strict=True)
        ],
    )


def strips_of(traces: RunTraces, end_s: float) -> list[Strip]:
    """Mode and regime, and the injected faults, if there are some."""
    shown = [one for one in FIRMWARE_TIMELINES if one.entity in STRIPS and len(traces.firmware)]
    strips = [state_strip(one, STRIPS[one.entity], traces.firmware) for one in shown]
    faults = [
        Span(fault.from_s, min(fault.end_s, end_s), fault.text, ALARM) for fault in injected_in(traces.run)
    ]
    return [*strips, Strip("injected fault", faults)] if faults else strips


def striker(traces: RunTraces) -> Plot | None:
    """The striker's position with the stop and the touch-downs."""
    plant, impacts = traces.plant, traces.impacts
    if len(plant) == 0:
        return None
    stop_m = traces.scenario.get("scene", {}).get("stop", {}).get("position_m")
    curves = [Curve(column(plant, "t_s"), column(plant, "x_m"), "truth", "true position")]
    if stop_m is not None and len(impacts):
        touched = np.full(len(impacts), float(stop_m))
        curves.append(Curve(column(impacts, "t_s"), touched, "bad", "impacts", dots=True))
    return Plot("Striker [m]", curves, [] if stop_m is None else [Level(float(stop_m), "stop")], 130.0)


def approach(traces: RunTraces, checks: Sequence[Check]) -> Plot | None:
    """The true approach speeds of the impacts with the limits of their checks."""
    if len(traces.impacts) == 0:
        return None
    speeds = Curve(
        column(traces.impacts, "t_s"), column(traces.impacts, "v_m_s"), "truth", "each impact", dots=True
    )
    levels = [
        Level(bound, f"{check.name} {check.limit}")
        for check in checks
        if check.name in ("impact_v_m_s", "largest_v_m_s")
        for bound in bounds_of(check)
    ]
    return Plot("Approach speed v⁻ [m/s]", [speeds], levels)


def speed(traces: RunTraces) -> Plot | None:
    """The crank's speed with its target."""
    curves = []
    if len(traces.plant):
        curves.append(Curve(*signal(traces.plant, "omega_rad_s"), "truth", "true"))
    if len(traces.firmware):
        curves.append(Curve(*signal(traces.firmware, "outputs.target_omega_rad_s"), "target", "target"))
    return Plot("Crank speed [rad/s]", curves) if curves else None


def torque(traces: RunTraces) -> Plot | None:
    """The motor's torque; without truth the requested one."""
    if len(traces.plant):
        return Plot(
            "Torque of the motor [N m]", [Curve(*signal(traces.plant, "motor_torque_n_m"), "truth", "")]
        )
    if len(traces.firmware):
        return Plot(
            "Torque [N m]", [Curve(*signal(traces.firmware, "outputs.torque_n_m"), "estimate", "requested")]
        )
    return None


def signal(records: Records, name: str) -> tuple[FloatArray, FloatArray]:
    """Times and values of a column."""
    return column(records, "t_s"), column(records, name)


def bounds_of(check: Check) -> list[float]:
    """The bounds that a check has."""
    return [bound for bound in (check.low, check.high) if bound is not None]


def whole_run(traces: RunTraces, end_s: float, cause: Cause | None) -> Picture | None:
    """The whole run: states, striker, approach speeds, crank speed, torque; None without any record."""
    parts = (striker(traces), approach(traces, checks_of(traces.scenario)), speed(traces), torque(traces))
    plots = [one for one in parts if one is not None]
    if not plots or end_s <= 0.0:
        return None
    marks_s = [] if cause is None else [cause.at_s]
    return Picture("The run over time", (0.0, end_s), strips_of(traces, end_s), plots, marks_s)


def close_up(traces: RunTraces, end_s: float, cause: Cause) -> Picture | None:
    """The time around a cause, with the quantity that decided and its limit."""
    start_s = min(max(cause.at_s - BEFORE_S, 0.0), max(end_s - BEFORE_S - AFTER_S, 0.0))
    window_s = (start_s, min(start_s + BEFORE_S + AFTER_S, end_s))
    parts = (striker(traces), decided_by(traces, window_s, cause), speed(traces), torque(traces))
    plots = [one for one in parts if one is not None]
    if not plots or window_s[0] >= window_s[1]:
        return None
    return Picture(f"Close-up: {cause.sentence}", window_s, strips_of(traces, end_s), plots, [cause.at_s])


def decided_by(traces: RunTraces, window_s: tuple[float, float], cause: Cause) -> Plot | None:
    """The quantity that exceeded its limit, with the limit; None if it is not a signal."""
    if cause.limit is None:
        return None
    if cause.condition is not None and cause.config is not None:
        from_row, to_row = np.searchsorted(column(traces.firmware, "t_s"), window_s)
        piece = traces.firmware[int(from_row) : int(to_row)]
        values = cause.condition.measure(piece, cause.config)
        source = cause.limit.parameter or "bound of the build"
        unit = f" [{cause.limit.unit}]" if cause.limit.unit else ""
        title = cause.limit.name[0].upper() + cause.limit.name[1:] + unit
        curve = Curve(column(piece, "t_s"), values, "estimate", "as the firmware has it")
        return Plot(title, [curve], [Level(float(cause.limit.bound), f"limit ({source})")])
    check = next(one for one in checks_of(traces.scenario) if one.name == cause.limit.name)
    shown = judged_signal(check)
    if shown is None:
        return None
    table, _, name = shown.signal.partition(".")
    records: Any = getattr(traces, table)
    if name not in (records.dtype.names or ()):
        return None
    levels = [Level(bound, f"{check.name} {check.limit}") for bound in bounds_of(check)]
    return Plot(shown.title, [Curve(*signal(records, name), "truth", "")], levels)


def judged_signal(check: Check) -> Judged | None:
    """The signal that a check limits; None if its figure is made of several values."""
    if check.expression is None:
        return SHOWN_BY.get(check.name)
    if EXTREME.fullmatch(check.expression.replace(" ", "")) is None:
        return None
    name = SIGNAL.findall(check.expression)[0]
    return Judged(name, f"{name} [{check.unit}]" if check.unit else name)
