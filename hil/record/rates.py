"""The rate at which the log holds each signal; the traces of plant and firmware hold all at every tick.

What figures and plots are made of is logged at every tick. `SLOW_BLOCKS` change slowly or repeat other
signals, and are logged at 100 Hz: of the plant the energies, the current, the requested torque, the leg's
motion and the encoder's readings; of the firmware the counters, sums, delays, last results and the gait lock,
and of the estimator the bias and the adapted variances. A signal that a check of the scenario names is logged
at every tick.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hil.record.run_traces import NO_RECORDS, column
from hil.record.traces.stored_trace import Columns, Records

SLOW_TICKS = 10
SLOW_BLOCKS = (
    "firmware.counters",
    "firmware.state.crank.disturbance_rad_s2",
    "firmware.state.crank.innovation_rad",
    "firmware.state.drive_link",
    "firmware.state.estimator.bias_m_s2",
    "firmware.state.estimator.flight",
    "firmware.state.estimator.model_variance",
    "firmware.state.estimator.p_bb",
    "firmware.state.estimator.p_vb",
    "firmware.state.estimator.p_xb",
    "firmware.state.estimator.p_xv",
    "firmware.state.estimator.sensor",
    "firmware.state.estimator.spread_m_s2",
    "firmware.state.estimator.touch_down",
    "firmware.state.gait.stride",
    "firmware.state.hold",
    "firmware.state.identify",
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


class Rates(NamedTuple):
    """A trace's columns as they are logged: at every tick, and at 100 Hz."""

    every_tick: Records
    slow: Records


def signals_of_checks(scenario: Mapping[str, Any]) -> frozenset[str]:
    """The signals that a scenario's own checks name.

    >>> sorted(signals_of_checks({"checks": [{"expression": "max(firmware.state.hold.gain)"}]}))
    ['firmware.state.hold.gain']
    """
    expressions = (str(check.get("expression", "")) for check in scenario.get("checks", []))
    return frozenset(name for expression in expressions for name in SIGNAL.findall(expression))


def slow_entity(trace: str) -> str:
    """Where a log has the slow signals of a trace."""
    return f"{trace}/slow"


def is_slow(signal: str) -> bool:
    """Whether a signal is one of `SLOW_BLOCKS`, or belongs to one.

    >>> is_slow("firmware.state.hold.gain"), is_slow("plant.x_m")
    (True, False)
    """
    return any(f"{signal}.".startswith(f"{block}.") for block in SLOW_BLOCKS)


def logged(records: Records, names: Sequence[str]) -> Columns:
    """Some columns of `records`."""
    return Columns({name: np.ascontiguousarray(records[name]) for name in names}, len(records))


def by_rate(trace: str, records: Records, named: frozenset[str]) -> Rates:
    """The records of a trace as they are logged; `named`: the signals that the scenario's own checks name."""
    names = records.dtype.names or ()
    slow = [name for name in names if is_slow(f"{trace}.{name}")]
    every_tick = logged(records, [name for name in names if name not in slow or f"{trace}.{name}" in named])
    if not slow:
        return Rates(every_tick, NO_RECORDS)
    return Rates(every_tick, logged(slow_rows(records), ["t_s", *slow]))


def slow_rows(records: Records) -> Records:
    """The records of the ticks at which the log holds all signals; the first where none of them is due."""
    due = column(records, "tick") % SLOW_TICKS == 0
    due[:1] |= not due.any()
    rows: Records = records[due]
    return rows
