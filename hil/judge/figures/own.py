"""Figures defined by a user: an expression of a run's logged signals within a time window.

Signals are named as in the log, `plant.omega_rad_s`, `firmware.outputs.torque_n_m`, and are arrays over the
plant's instants; firmware signals have the value of the last tick by each instant. `FUNCTIONS` reduce them to
numbers. Figures of a step response are python-control's, for the signal minus its first value in the window.
"""

import difflib
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from asteval import Interpreter
from numpy.typing import NDArray

from hil.record.run_traces import column
from hil.record.traces.firmware_trace import fields_of
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.stored_trace import Records
from hil.record.traces.trace import flatten

Signal = NDArray[np.float64]

FINAL_SHARE: Final = 0.1
"""Share of a window, at its end, whose median is the final value of a step response."""
SAMPLES_TO_TRY: Final = 200

FUNCTIONS: Final[Mapping[str, Callable[[Any], Any]]] = {
    "min": lambda signal: float(np.min(signal)),
    "max": lambda signal: float(np.max(signal)),
    "mean": lambda signal: float(np.mean(signal)),
    "median": lambda signal: float(np.median(signal)),
    "std": lambda signal: float(np.std(signal)),
    "rms": lambda signal: float(np.sqrt(np.mean(np.square(signal)))),
    "first": lambda signal: float(signal[0]),
    "last": lambda signal: float(signal[-1]),
    "abs": np.abs,
    "sqrt": np.sqrt,
}
OF_A_STEP: Final = {"rise_s": "RiseTime", "settling_s": "SettlingTime", "overshoot": "Overshoot"}
"""Our names for python-control's figures of a step response; the overshoot is in percent of the step."""


class ExpressionError(ValueError):
    """An expression cannot be evaluated; the message says why."""


class Window(NamedTuple):
    """Time window of a figure in simulated seconds, without its end."""

    from_s: float
    to_s: float


class Columns(Mapping[str, Signal]):
    """Columns by name, each read at first use, since those of a long run may not fit into memory together."""

    def __init__(self, names: Iterable[str], read: Callable[[str], Signal]) -> None:
        self._names = tuple(names)
        self._read = read

    def __getitem__(self, name: str) -> Signal:
        if name not in self._names:
            raise KeyError(name)
        return self._read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class Signals:
    """The columns of a trace, or of one of its dotted prefixes, as attributes."""

    def __init__(self, name: str, columns: Mapping[str, Signal]) -> None:
        self._name = name
        self._columns = columns

    def __getattr__(self, name: str) -> Any:
        if name in self._columns:
            return self._columns[name]
        inner = [key.removeprefix(f"{name}.") for key in self._columns if key.startswith(f"{name}.")]
        if inner:
            return Signals(
                f"{self._name}.{name}", Columns(inner, lambda rest: self._columns[f"{name}.{rest}"])
            )
        heads = list(dict.fromkeys(key.partition(".")[0] for key in self._columns))
        near = difflib.get_close_matches(name, heads, n=3, cutoff=0.4) or heads
        raise AttributeError(f"no signal {self._name}.{name}; it has {', '.join(near)}")


def step_figure(key: str, t_s: Signal) -> Callable[[Signal], float]:
    """A figure of a step response over the window `t_s`."""

    def figure(signal: Signal) -> float:
        from control import step_info  # noqa: PLC0415 - the import takes a second, and few figures need it

        response = signal - signal[0]
        final = float(np.median(response[-math.ceil(FINAL_SHARE * response.size) :]))
        return float(step_info(response, T=t_s - t_s[0], yfinal=final)[key])

    return figure


def worked_out(expression: str, t_s: Signal, signals: Mapping[str, Mapping[str, Signal]]) -> float:
    """Evaluate the expression on signals over `t_s`; raises ExpressionError."""
    names = {name: Signals(name, columns) for name, columns in signals.items()}
    steps = {name: step_figure(key, t_s) for name, key in OF_A_STEP.items()}
    interpreter = Interpreter(symtable={**FUNCTIONS, **steps, **names, "pi": math.pi}, minimal=True)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        value = interpreter(expression, show_errors=False)
    if interpreter.error:
        _, message = interpreter.error[0].get_error()
        raise ExpressionError(f"{expression!r} cannot be worked out: {message.splitlines()[-1]}")
    if np.ndim(value) != 0:
        known = ", ".join([*FUNCTIONS, *OF_A_STEP])
        raise ExpressionError(f"{expression!r} is a signal; make a number of it, by {known}")
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ExpressionError(f"{expression!r} gives {value!r}; wanted a number")
    return float(value)


def refuse_unknown(expression: str) -> None:
    """Raise ExpressionError if the expression has an unknown name or form and no run could evaluate it."""
    t_s = np.linspace(0.0, 1.0, SAMPLES_TO_TRY)
    rising = 1.0 - np.exp(-10.0 * t_s)
    columns = {
        "plant": PlantRecord._fields,
        "firmware": [one.name for name, kind in fields_of(walks=True) for one in flatten(name, kind)],
    }
    worked_out(expression, t_s, {trace: dict.fromkeys(names, rising) for trace, names in columns.items()})


def held(records: Records, instants_s: Signal) -> Mapping[str, Signal]:
    """The columns at `instants_s`, each with its last recorded value; NaN before the first record."""
    newest = np.searchsorted(column(records, "t_s"), instants_s, side="right") - 1
    return Columns(
        records.dtype.names or (), lambda name: np.where(newest >= 0, column(records, name)[newest], np.nan)
    )


def own_figure(expression: str, window: Window, plant: Records, firmware: Records) -> float | None:
    """The figure of a run; None without records in the window, or if it cannot be evaluated on them."""
    t_s = column(plant, "t_s")
    if len(firmware) == 0 or len(t_s) == 0:
        return None
    rows = (t_s >= window.from_s) & (t_s < window.to_s)
    instants_s = t_s[rows]
    if instants_s.size == 0:
        return None
    signals = {
        "plant": Columns(plant.dtype.names or (), lambda name: column(plant, name)[rows]),
        "firmware": held(firmware, instants_s),
    }
    try:
        value = worked_out(expression, instants_s, signals)
    except ExpressionError:
        return None
    return value if math.isfinite(value) else None
