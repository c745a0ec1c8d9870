"""At which rate the log holds what the firmware knew; its trace holds all of it at every tick.

What figures and plots are made of is logged at every tick. Blocks that keep books (counters, sums, delays,
last results) change slowly, repeat other columns or count ticks: they are logged at 100 Hz, and the
covariances between the estimator's states with them. A signal that a check of the scenario's own names is
logged at every tick.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hil.record.run_traces import NO_RECORDS, column
from hil.record.traces.stored_trace import Columns, Records

SLOW_TICKS = 10
SLOW_BLOCKS = (
    "counters",
    "state.calm",
    "state.drive_link",
    "state.estimator.flight",
    "state.estimator.p_vb",
    "state.estimator.p_xb",
    "state.estimator.p_xv",
    "state.estimator.sensor",
    "state.estimator.touch_down",
    "state.hold",
    "state.identify",
    "state.monitors",
    "state.regime",
    "state.speed",
    "state.start",
    "state.supervisor",
    "state.therapy",
)
SIGNAL = re.compile(r"\bfirmware\.([\w.]+)")


class Rates(NamedTuple):
    """The firmware's columns as they are logged: at every tick, and at 100 Hz."""

    every_tick: Records
    slow: Records


def signals_of_checks(scenario: Mapping[str, Any]) -> frozenset[str]:
    """The firmware's columns that a scenario's own checks name.

    >>> sorted(signals_of_checks({"checks": [{"expression": "max(firmware.state.hold.gain)"}]}))
    ['state.hold.gain']
    """
    expressions = (str(check.get("expression", "")) for check in scenario.get("checks", []))
    return frozenset(name for expression in expressions for name in SIGNAL.findall(expression))


def is_slow(name: str) -> bool:
    """Whether a column is one of `SLOW_BLOCKS`, or belongs to one.

    >>> is_slow("state.hold.gain"), is_slow("state.estimator.x_m")
    (True, False)
    """
    return any(f"{name}.".startswith(f"{block}.") for block in SLOW_BLOCKS)


def logged(records: Records, names: Sequence[str]) -> Columns:
    """Some columns of `records`."""
    return Columns({name: np.ascontiguousarray(records[name]) for name in names}, len(records))


def by_rate(records: Records, named: frozenset[str]) -> Rates:
    """The firmware's records as they are logged; `named`: by the scenario's own checks."""
    names = records.dtype.names or ()
    slow = [name for name in names if is_slow(name) and name not in named]
    every_tick = logged(records, [name for name in names if name not in slow])
    if not slow:
        return Rates(every_tick, NO_RECORDS)
    tenth = records[column(records, "tick") % SLOW_TICKS == 0]
    return Rates(every_tick, logged(tenth, ["t_s", *slow]))
