"""Figures defined by a user: an expression of a run's logged signals within a time window.

Signals are named as in the log, `plant.omega_rad_s`, `firmware.outputs.torque_n_m`, and are arrays over the
plant's instants; firmware signals have the value of the last tick by each instant. `REDUCERS` reduce them to
numbers. Figures of a step response are python-control's, for the signal minus its first value in the window.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from hil.figures.expression import Expression, ExpressionError, Names, Read, Signal
from hil.figures.hold import Window
from hil.record.run_traces import column
from hil.record.traces.firmware_trace import fields_of
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.stored_trace import Records
from hil.record.traces.trace import flatten

FINAL_SHARE: Final = 0.1
"""Share of a window, at its end, whose median is the final value of a step response."""
SAMPLES_TO_TRY: Final = 200
OF_AN_OWN_CONTROLLER: Final = re.compile(r"\bfirmware\.(own\.[A-Za-z_][\w.]*)")
"""Names that only a run with the user's own controller has."""

REDUCERS: Final[Mapping[str, Callable[[Signal], float]]] = {
    "min": lambda signal: float(np.min(signal)),
    "max": lambda signal: float(np.max(signal)),
    "mean": lambda signal: float(np.mean(signal)),
    "median": lambda signal: float(np.median(signal)),
    "std": lambda signal: float(np.std(signal)),
    "rms": lambda signal: float(np.sqrt(np.mean(np.square(signal)))),
    "first": lambda signal: float(signal[0]),
    "last": lambda signal: float(signal[-1]),
}
ELEMENTWISE: Final[Mapping[str, Callable[[Any], Any]]] = {"abs": np.abs, "sqrt": np.sqrt}
OF_A_STEP: Final = {"rise_s": "RiseTime", "settling_s": "SettlingTime", "overshoot": "Overshoot"}
"""Our names for python-control's figures of a step response; the overshoot is in percent of the step."""


def step_figure(key: str, t_s: Signal) -> Callable[[Signal], float]:
    """A figure of a step response over the window `t_s`."""

    def figure(signal: Signal) -> float:
        from control import step_info  # noqa: PLC0415 - the import takes a second, and few figures need it

        response = signal - signal[0]
        final = float(np.median(response[-math.ceil(FINAL_SHARE * response.size) :]))
        return float(step_info(response, T=t_s - t_s[0], yfinal=final)[key])

    return figure


def evaluate(expression: str, t_s: Signal, names: Names, read: Read) -> float:
    """Evaluate the expression on signals over `t_s`; raises ExpressionError."""
    steps = {name: step_figure(key, t_s) for name, key in OF_A_STEP.items()}
    return Expression(expression, names, read, {**REDUCERS, **steps}, ELEMENTWISE).evaluate()


def refuse_unknown(expression: str) -> None:
    """Raise ExpressionError if no run could evaluate the expression, or all runs would give one value."""
    t_s = np.linspace(0.0, 1.0, SAMPLES_TO_TRY)
    read: list[str] = []

    def rise(trace: str, name: str) -> Signal:
        read.append(f"{trace}.{name}")
        return t_s

    firmware = [one.name for name, kind in fields_of(walks=True) for one in flatten(name, kind)]
    names = {"plant": PlantRecord._fields, "firmware": firmware + OF_AN_OWN_CONTROLLER.findall(expression)}
    evaluate(expression, t_s, names, rise)
    if not read:
        raise ExpressionError(
            f"{expression!r} names no signal, so that its value is the same in every run; name one, such as "
            "plant.x_m"
        )


def own_figure(expression: str, window: Window, plant: Records, firmware: Records) -> float:
    """The figure over a window without its end; raises ExpressionError, which says why a run has none."""
    t_s, ticks_s = column(plant, "t_s"), column(firmware, "t_s")
    if len(ticks_s) == 0 or len(t_s) == 0:
        raise ExpressionError("plant or firmware recorded no tick")
    rows = (t_s >= window.start_s) & (t_s < window.end_s)
    instants_s = t_s[rows]
    if instants_s.size == 0:
        raise ExpressionError(
            f"nothing was recorded from {window.start_s:g} s to {window.end_s:g} s: "
            f"the run lasted from {t_s[0]:g} s to {t_s[-1]:g} s"
        )
    newest = np.searchsorted(ticks_s, instants_s, side="right") - 1

    def read(trace: str, name: str) -> Signal:
        """A signal at the instants; the firmware's hold their last value, and are NaN before the first."""
        if trace == "plant":
            return column(plant, name)[rows]
        return np.where(newest >= 0, column(firmware, name)[newest], np.nan)

    names = {"plant": plant.dtype.names or (), "firmware": firmware.dtype.names or ()}
    value = evaluate(expression, instants_s, names, read)
    if not math.isfinite(value):
        early = "firmware." in expression and instants_s[0] < ticks_s[0]
        remedy = f"; the firmware has no signal before its first tick at {ticks_s[0]:g} s, so begin later"
        raise ExpressionError(f"{expression!r} gives {value:g}{remedy if early else ''}")
    return value
