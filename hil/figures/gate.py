"""How much of a contact's force and impulse the gate let pass before the motor's torque ended."""

import numpy as np

from hil.figures.records import GateFigures, no_figures
from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces, column

CLEAR_S = 0.013
"""Least time between a contact and a fault of the script. For this time the accelerometer shows a kick: a
half-sine of 10 ms and the low-pass."""
REACTION_S = 0.004
"""Time from a force or an impulse to the torque's end: low-pass, frame, and three ticks."""
WATCHED_S = 0.05
"""Time after a contact in which any torque shows that it did not end the motion."""


def gate_figures(traces: RunTraces) -> GateFigures:
    """The largest force and impulse that were reached before the torque ended; 0 without a contact.

    Contacts within `CLEAR_S` of a fault do not count: a kick or a lost sample hides what they are. None
    without truth, and with a rigid stop, which has no force.
    """
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    if len(plant) == 0 or not np.isfinite(column(impacts, "peak_force_n")).all():
        return no_figures(GateFigures)
    t_s, force_n, begins_s = column(plant, "t_s"), column(plant, "stop_force_n"), column(impacts, "t_s")
    driven_s = column(firmware, "t_s")[column(firmware, "outputs.torque_n_m") != 0.0]
    free = np.append(np.flatnonzero(~(force_n > 0.0)), len(force_n))
    firsts = np.searchsorted(t_s, begins_s)
    faults = faults_of(traces.run)
    forces_n, impulses_n_s = [0.0], [0.0]
    for begin_s, first, after in zip(begins_s, firsts, free[np.searchsorted(free, firsts)], strict=True):
        end_s = max(begin_s, t_s[after - 1])
        if any(one.from_s - CLEAR_S < end_s and begin_s < one.end_s + CLEAR_S for one in faults):
            continue
        last = np.searchsorted(driven_s, end_s + WATCHED_S) - 1
        until_s = driven_s[last] - REACTION_S if last >= 0 else 0.0
        reached = min(after, np.searchsorted(t_s, until_s, side="right"))
        part_n = force_n[first:reached]
        forces_n.append(float(part_n.max(initial=0.0)))
        impulses_n_s.append(float(np.trapezoid(part_n, t_s[first:reached])))
    return GateFigures(passed_n=max(forces_n), passed_n_s=max(impulses_n_s))
