"""The rate at which the log holds each signal; the traces of plant and firmware hold all at every tick.

Signals used by figures and plots are logged at every tick. `SLOW_BLOCKS` change slowly or repeat other
signals: the plant's energies, current, requested torque, leg motion and encoder readings; the firmware's
counters, sums, delays, last results and gait lock, and the estimator's bias and adapted variances. The log
has them at 100 Hz and repeats each value until the next, which takes a tenth of the room. It also has them at
the tick in which the firmware latches a fault, to show the limit that was exceeded. A signal that is named in
a check of the scenario is logged at every tick.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from hil.record.run_traces import column
from hil.record.traces.stored_trace import Columns, Records
from plant_sim.arrays import BoolArray

SLOW_TICKS = 10
FAULT = "outputs.fault"
SLOW_BLOCKS = (
    "firmware.counters",
    "firmware.state.crank.disturbance_rad_s2",
    "firmware.state.drive_link",
    "firmware.state.estimator.bias_m_s2",
    "firmware.state.estimator.model_variance",
    "firmware.state.estimator.p_bb",
    "firmware.state.estimator.p_vb",
    "firmware.state.estimator.p_xb",
    "firmware.state.estimator.p_xv",
    "firmware.state.estimator.sensor",
    "firmware.state.estimator.spread_m_s2",
    "firmware.state.estimator.touch_down",
    "firmware.state.gait.stride",
    "firmware.state.gate",
    "firmware.state.hold",
    "firmware.state.gait_lock",
    "firmware.state.monitors",
    "firmware.state.regime",
    "firmware.state.speed",
    "firmware.state.spin_down",
    "firmware.state.start",
    "firmware.state.stride_harmonic",
    "firmware.state.supervisor",
    "plant.ankle_j",
    "plant.current_a",
    "plant.drive_work_j",
    "plant.encoder_position_rev",
    "plant.encoder_velocity_rev_s",
    "plant.friction_j",
    "plant.gait.ankle_n_m_kg",
    "plant.gait.axis_m_s2",
    "plant.gait.forward_m_s2",
    "plant.gait.heel_load",
    "plant.gait.shank_rad",
    "plant.gait.shank_rad_s",
    "plant.gait.stride_hz",
    "plant.gait.toe_load",
    "plant.gait.up_m_s2",
    "plant.housing_work_j",
    "plant.impact_loss_j",
    "plant.stored_j",
    "plant.torque_command_n_m",
)
SIGNAL = re.compile(r"\b(?:firmware|plant)\.[\w.]+")


def signals_of_checks(scenario: Mapping[str, Any]) -> frozenset[str]:
    """The signals that are named in a scenario's checks.

    >>> sorted(signals_of_checks({"checks": [{"expression": "max(firmware.state.hold.gain)"}]}))
    ['firmware.state.hold.gain']
    """
    expressions = (str(check.get("expression", "")) for check in scenario.get("checks", []))
    return frozenset(name for expression in expressions for name in SIGNAL.findall(expression))


def is_slow(signal: str) -> bool:
    """Whether a signal is one of `SLOW_BLOCKS`, or belongs to one.

    >>> is_slow("firmware.state.hold.gain"), is_slow("plant.x_m")
    (True, False)
    """
    return any(f"{signal}.".startswith(f"{block}.") for block in SLOW_BLOCKS)


class Held:
    """The records of a trace as logged: slow signals hold their value between the ticks at 100 Hz."""

    def __init__(self, trace: str, named: frozenset[str]) -> None:
        """`named`: the signals named in the scenario's checks."""
        self._trace = trace
        self._named = named
        self._last: dict[str, Any] = {}
        """The values that are held from the last records on, by column."""
        self._fault = 0.0

    def hold(self, records: Records) -> Columns:
        """The next records of the trace as logged, in memory."""
        due = (column(records, "tick") % SLOW_TICKS == 0) | self._latches(records)
        rows = np.maximum.accumulate(np.where(due, np.arange(len(records)), -1))
        columns = {name: np.ascontiguousarray(records[name]) for name in records.dtype.names or ()}
        for name, values in columns.items():
            signal = f"{self._trace}.{name}"
            if is_slow(signal) and signal not in self._named:
                before = self._last.get(name, values[0])
                columns[name] = np.where(rows >= 0, values[rows], before)
                self._last[name] = columns[name][-1]
        return Columns(columns, len(records))

    def _latches(self, records: Records) -> BoolArray:
        """Whether the firmware's fault changes in each record; never in another trace."""
        fault = column(records, FAULT) if FAULT in (records.dtype.names or ()) else np.zeros(len(records))
        changes: BoolArray = np.diff(fault, prepend=self._fault) != 0.0
        self._fault = float(fault[-1]) if len(fault) else self._fault
        return changes


def slow_rows(records: Records) -> Records:
    """The records of the ticks at which the log holds all signals; the first record if there is none."""
    due = column(records, "tick") % SLOW_TICKS == 0
    due[:1] |= not due.any()
    rows: Records = records[due]
    return rows
