"""How much of a contact's force and impulse the gate let pass before the commanded torque ended."""

import numpy as np

from hil.figures.records import GateFigures, no_figures
from hil.record.run_faults import RunFault, faults_of
from hil.record.run_traces import RunTraces, column

CLEAR_S = 0.013
"""Least time between a contact and a fault that hides it. For this time the accelerometer shows a kick: a
half-sine of 10 ms and the low-pass."""
REACTION_S = 0.004
"""Time from a force or an impulse to the torque's end: low-pass, frame, and three ticks."""
WATCHED_S = 0.05
"""Time after a contact in which any torque shows that it did not end the motion."""


def may_hide(fault: RunFault) -> bool:
    """Whether readings of a contact may be wrong or missing: but for faults of other frames."""
    return not fault.frames or "Accelerometer" in fault.frames


def gate_figures(traces: RunTraces) -> GateFigures:
    """The largest force and impulse at the ticks of a contact, up to `REACTION_S` before the torque ended.

    0 without a contact. None without a trace of plant or firmware, and with a rigid stop, which has no force.
    """
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    if len(plant) == 0 or len(firmware) == 0 or not np.isfinite(column(impacts, "peak_force_n")).all():
        return no_figures(GateFigures)
    t_s, force_n = column(plant, "t_s"), column(plant, "stop_force_n")
    torque_n_m = column(firmware, "outputs.torque_n_m")
    driven_s = column(firmware, "t_s")[np.isfinite(torque_n_m) & (torque_n_m != 0.0)]
    changes = np.diff(np.concatenate([[False], force_n > 0.0, [False]]).astype(np.int8))
    hiding = [one for one in faults_of(traces.run) if may_hide(one)]
    forces_n, impulses_n_s = [0.0], [0.0]
    for first, after in zip(np.flatnonzero(changes == 1), np.flatnonzero(changes == -1), strict=True):
        begin_s, end_s = t_s[first], t_s[after - 1]
        if any(one.from_s - CLEAR_S < end_s and begin_s < one.end_s + CLEAR_S for one in hiding):
            continue
        last = np.searchsorted(driven_s, end_s + WATCHED_S) - 1
        until_s = driven_s[last] - REACTION_S if last >= 0 else -np.inf
        reached = min(after, np.searchsorted(t_s, until_s, side="right"))
        part_n = force_n[first:reached]
        forces_n.append(float(part_n.max(initial=0.0)))
        impulses_n_s.append(float(np.trapezoid(part_n, t_s[first:reached])))
    return GateFigures(passed_n=max(forces_n), passed_n_s=max(impulses_n_s))
