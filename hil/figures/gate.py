"""How much of a contact's force and impulse the gate let pass before the motor's torque ended."""

import numpy as np

from hil.figures.records import GateFigures, no_figures
from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces, column
from plant_sim.arrays import FloatArray

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
    t_s, force_n = column(plant, "t_s"), column(plant, "stop_force_n")
    driven_s = column(firmware, "t_s")[column(firmware, "outputs.torque_n_m") != 0.0]
    forces_n, impulses_n_s = [0.0], [0.0]
    for begin_s in column(impacts, "t_s").tolist():
        first = int(np.searchsorted(t_s, begin_s))
        lasts = int(np.argmin(np.append(force_n[first:], 0.0) > 0.0))
        end_s = begin_s if lasts == 0 else float(t_s[first + lasts - 1])
        if any(f.from_s - CLEAR_S < end_s and begin_s < f.end_s + CLEAR_S for f in faults_of(traces.run)):
            continue
        until_s = driven_s[np.searchsorted(driven_s, begin_s) : np.searchsorted(driven_s, end_s + WATCHED_S)]
        reached = first + int(
            np.count_nonzero(t_s[first : first + lasts] <= until_s.max(initial=0.0) - REACTION_S)
        )
        part_n: FloatArray = force_n[first:reached]
        forces_n.append(float(part_n.max(initial=0.0)))
        impulses_n_s.append(float(np.trapezoid(part_n, t_s[first:reached])))
    return GateFigures(passed_n=max(forces_n), passed_n_s=max(impulses_n_s))
