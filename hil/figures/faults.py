"""Figures of faults and of the transition to the safe state."""

from collections.abc import Mapping
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface.enums import Fault, Mode
from firmware_py.interface.modes import MOVING
from hil.figures import detection
from hil.figures.hold import Window, capture
from hil.figures.records import FaultFigures, LatchedFigures, SafeStateFigures, no_figures
from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import FloatArray

NO_TORQUE_N_M = 1e-5
"""Largest torque that counts as none. An idle axis exerts none, the d-q motor less than this within 11 ms;
a torque that is held where its sign changes may be half a millinewton metre, and must be seen to end."""


SETTLE_S = 0.1
"""Time for the motor to become torque-free after a stop, a fault or the end of a node."""


BEFORE_FAULT_S = 0.2
"""Time before a fault in which its cause is searched: several watchdog times of the sensors."""


SILENT_S = 0.2
"""A node whose trace ends by this time before the other node's has failed; regular ends are closer."""


def zero_after(t_s: FloatArray, torque_n_m: FloatArray, since_s: float) -> float | None:
    """Time in s after `since_s` until |torque| stays below `NO_TORQUE_N_M`; None if it never does.

    In whole nanoseconds, so that a time that ends at its limit is not beyond it by the rounding of a sum.
    """
    later = t_s >= since_s
    if not later.any():
        return None
    pushing = np.flatnonzero(~(np.abs(torque_n_m[later]) < NO_TORQUE_N_M))
    if len(pushing) == 0:
        return 0.0
    if pushing[-1] == np.count_nonzero(later) - 1:
        return None
    return round(float(t_s[later][pushing[-1] + 1] - since_s), 9)


class DriveEnd(NamedTuple):
    """Cause and time from which the drive must stay off."""

    cause: str
    at_s: float


def drive_end(plant: Records, firmware: Records) -> DriveEnd | None:
    """The last end of driving, by a failed node, a fault, an E-stop or a stop; None if the drive stays on."""
    t_s, mode = column(firmware, "t_s"), column(firmware, "outputs.mode")
    driving = np.flatnonzero(np.isin(mode, MOVING))
    if len(driving) == 0:
        return None
    plant_t_s = column(plant, "t_s")
    plant_end_s = float(plant_t_s[-1]) if len(plant_t_s) else 0.0
    last = driving[-1]
    if len(plant) and plant_end_s < t_s[-1] - SILENT_S and plant_end_s <= t_s[last]:
        return DriveEnd("plant-silent", plant_end_s)
    if last < len(mode) - 1:
        after = mode[last + 1]
        cause = "fault" if after == Mode.FAULT else "e-stop" if after == Mode.E_STOP else "stop"
        return DriveEnd(cause, float(t_s[last + 1]))
    if t_s[-1] < plant_end_s - SILENT_S:
        return DriveEnd("firmware-silent", float(t_s[-1]))
    return None


def safe_state_figures(
    plant: Records, firmware: Records, impacts: Records, end: DriveEnd | None
) -> SafeStateFigures:
    """Torque and impacts of the drive after `end`."""
    if end is None:
        return no_figures(SafeStateFigures)
    return SafeStateFigures(
        cause=end.cause,
        at_s=end.at_s,
        torque_zero_after_s=zero_after(column(plant, "t_s"), column(plant, "motor_torque_n_m"), end.at_s),
        command_zero_after_s=zero_after(
            column(firmware, "t_s"), column(firmware, "outputs.torque_n_m"), end.at_s
        ),
        impacts_after=int(np.count_nonzero(column(detection.select_strong(impacts), "t_s") > end.at_s))
        if len(plant)
        else None,
    )


def first_of(run: Mapping[str, Any]) -> float | None:
    """The time at which the first fault begins."""
    return min((fault.from_s for fault in faults_of(run)), default=None)


def undisturbed(run: Mapping[str, Any], hold: Window) -> list[Window]:
    """The intervals of the hold in which impacts count again: from each fault's end to the next one's begin.

    A fault that does not end disturbs when it begins. Faults that overlap are one.
    """
    faults = sorted((one for one in faults_of(run) if one.from_s < hold.end_s), key=lambda one: one.from_s)
    ends_s = accumulate((one.from_s if one.to_s is None else one.to_s for one in faults), max)
    nexts_s = [*(one.from_s for one in faults), hold.end_s][1:]
    return [Window(*pair) for pair in zip(ends_s, nexts_s, strict=True) if pair[1] > pair[0]]


def impacts_again(times_s: FloatArray, run: Mapping[str, Any], hold: Window, period_s: float) -> float | None:
    """The longest time after a fault until every drive period had an impact again, up to the next fault.

    None if impacts are not back, or a fault still lasts, at the hold's end: no fault hides missing impacts.
    """
    windows = undisturbed(run, hold)
    if not windows or windows[-1].end_s < hold.end_s:
        return None
    longest_s = 0.0
    for window in windows:
        within = times_s[(times_s >= window.start_s) & (times_s <= window.end_s)]
        again_s = capture(within, window, period_s)
        if again_s is None and window is windows[-1]:
            return None
        longest_s = max(longest_s, (window.end_s if again_s is None else again_s) - window.start_s)
    return longest_s


def fault_figures(traces: RunTraces, hold: Window | None) -> FaultFigures:
    """Torque, speed and impacts after the first fault of the script, and impacts again after each."""
    plant, impacts = traces.plant, traces.impacts
    begin_s = first_of(traces.run)
    if begin_s is None or len(plant) == 0 or column(plant, "t_s")[-1] < begin_s:
        return no_figures(FaultFigures)
    t_s, torque_n_m = column(plant, "t_s"), column(plant, "motor_torque_n_m")
    speed = column(plant, "omega_rad_s")
    since = t_s >= begin_s
    strong = detection.select_strong(impacts)
    strong_t_s, forces = column(strong, "t_s"), column(strong, "peak_force_n")
    zero_s = zero_after(t_s, torque_n_m, begin_s)
    forces_n = forces[strong_t_s >= begin_s]
    hit = forces_n[np.isfinite(forces_n)]
    again_s = None
    if hold is not None:
        turning = np.abs(speed[hold.holds(t_s)])
        period_s = 2.0 * np.pi / float(turning.mean()) if len(turning) and turning.mean() > 0.0 else np.inf
        again_s = impacts_again(strong_t_s, traces.run, hold, period_s)
    return FaultFigures(
        torque_zero_after_s=zero_s,
        impacts_after_zero=None if zero_s is None else int(np.count_nonzero(strong_t_s > begin_s + zero_s)),
        largest_torque_n_m=float(np.max(np.abs(torque_n_m[since]))),
        largest_speed_rad_s=float(np.max(np.abs(speed[since]))),
        peak_force_n=float(hit.max()) if len(hit) else 0.0 if len(forces_n) == 0 else None,
        impacts_again_after_s=again_s,
        turning_at_end_rad_s=float(speed[t_s > t_s[-1] - 0.5].mean()),
    )


def torque_after(plant: Records, end: DriveEnd | None) -> float | None:
    """The largest |motor torque| from `SETTLE_S` after the end of driving on, in N m."""
    if end is None:
        return None
    settled = column(plant, "motor_torque_n_m")[column(plant, "t_s") >= end.at_s + SETTLE_S]
    return float(np.max(np.abs(settled))) if len(settled) else None


def first_fault(firmware: Records) -> Fault:
    """The first fault that the firmware latched."""
    fault = column(firmware, "outputs.fault")
    latched = fault[fault != Fault.NONE]
    return Fault(int(latched[0])) if len(latched) else Fault.NONE


def held_ms(records: Records, until_s: float, period_s: float) -> float | None:
    """The longest stall of a loop before `until_s` in ms; None without two ticks in `BEFORE_FAULT_S`."""
    t_s = column(records, "t_s")
    near = (t_s > until_s - BEFORE_FAULT_S) & (t_s <= until_s + period_s)
    ticks = column(records, "tick")[near]
    return 1e3 * period_s * float(np.diff(ticks).max() - 1) if len(ticks) > 1 else None


def latched_figures(plant: Records, firmware: Records, period_s: float) -> LatchedFigures:
    """Stalls of the loops before the first fault."""
    latched = np.flatnonzero(column(firmware, "outputs.fault") != Fault.NONE)
    if len(latched) == 0:
        return no_figures(LatchedFigures)
    at_s = float(column(firmware, "t_s")[latched[0]])
    return LatchedFigures(at_s, held_ms(firmware, at_s, period_s), held_ms(plant, at_s, period_s))
