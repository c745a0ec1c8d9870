"""Figures of a walk: phase error, pulses inside and outside of the window, the end of the walk.

With the crank off, the leg's motion alone may drive the striker against the stop. These pulses are counted
separately from the pulses that follow a stop; the last of the latter is followed by a pause.

A pulse is a true impact of at least `detection.WEAKEST_V_M_S`; its phase is the true gait phase at
touch-down. The window is taken from the firmware's parameters.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface.enums import Mode
from firmware_py.interface.modes import MOVING
from firmware_py.shell.parameters import config_from
from hil.figures import detection
from hil.figures.hold import Window
from hil.figures.records import GaitFigures, no_figures
from hil.figures.true_regime import impacts_by_period
from hil.record.run_traces import RunTraces, column, pair_by_tick
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import BoolArray, FloatArray
from plant_sim.result import LegState

SETTLING_STRIDES = 4
"""Strides at the beginning of a hold in which the crank may still be locking to the gait."""


PAUSE_S = 2.0
"""Shortest pause after which pulses are no longer caused by the drive."""


class PushOff(NamedTuple):
    """The firmware's window for pulses, in shares of the gait cycle."""

    start: float
    end: float

    def holds(self, phase: FloatArray) -> BoolArray:
        """Mask of the phases within the window."""
        return (phase >= self.start) & (phase <= self.end)


class Pulses(NamedTuple):
    """Impacts with the true gait phase at touch-down, NaN without a walk; shapes (n,)."""

    t_s: FloatArray
    v_m_s: FloatArray
    phase: FloatArray


class GaitEnd(NamedTuple):
    """The end of a steady walk: its cause and time."""

    cause: str
    at_s: float


def push_off(scenario: Mapping[str, Any]) -> PushOff:
    """The window of a scenario's firmware."""
    gait = config_from(scenario.get("firmware", {})).p.gait
    return PushOff(gait.window_start, gait.window_end)


def phase_at(plant: Records, t_s: FloatArray) -> FloatArray:
    """The true phase at the last tick before each of `t_s`; a tick is about a thousandth of a gait cycle."""
    if len(plant) == 0:
        return np.full(len(t_s), np.nan)
    at = np.searchsorted(column(plant, "t_s"), t_s, side="right") - 1
    return np.asarray(column(plant, "gait.phase")[np.maximum(at, 0)])


def pulses_of(plant: Records, impacts: Records) -> Pulses:
    """The pulses among `impacts`."""
    strong = detection.select_strong(impacts)
    t_s = column(strong, "t_s")
    return Pulses(t_s, column(strong, "v_m_s"), phase_at(plant, t_s))


def phase_error(plant: Records, firmware: Records) -> tuple[FloatArray, FloatArray]:
    """Times in s and circular errors in cycles of the estimated phase, where estimate and truth exist."""
    truth, estimated = pair_by_tick(plant, firmware)
    error = (column(estimated, "state.gait.phase") - column(truth, "gait.phase") + 0.5) % 1.0 - 0.5
    known = np.isfinite(error)
    return column(truth, "t_s")[known], error[known]


def heel_strikes(plant: Records) -> FloatArray:
    """The times in s at which a new cycle of the true phase begins."""
    phase, t_s = column(plant, "gait.phase"), column(plant, "t_s")
    return t_s[1:][np.diff(np.nan_to_num(phase, nan=1.0)) < -0.5]


def gait_end(plant: Records, since_s: float) -> GaitEnd | None:
    """The first stumble or standstill after `since_s`."""
    later = plant[column(plant, "t_s") >= since_s]
    ends = {
        "stumble": column(later, "gait.tripping") != 0.0,
        "stop": column(later, "gait.state") == LegState.STANDING,
    }
    found = [(float(column(later, "t_s")[where][0]), cause) for cause, where in ends.items() if where.any()]
    return GaitEnd(min(found)[1], min(found)[0]) if found else None


def next_start_s(firmware: Records, after_s: float) -> float:
    """The time in s of the first start of the crank after `after_s`; infinite without a start."""
    t_s, mode = column(firmware, "t_s"), column(firmware, "outputs.mode")
    begins = np.flatnonzero((mode[1:] == Mode.SOFT_START) & (mode[:-1] != Mode.SOFT_START)) + 1
    later = t_s[begins][t_s[begins] > after_s]
    return float(later[0]) if len(later) else float("inf")


def is_following(pulses_s: FloatArray, at_s: float, until_s: float) -> BoolArray:
    """Mask of the pulses that follow `at_s` without a pause, up to `until_s`."""
    later = np.flatnonzero((pulses_s > at_s) & (pulses_s < until_s))
    gaps = np.diff(np.concatenate([[at_s], pulses_s[later]])) >= PAUSE_S
    end = int(np.argmax(gaps)) if gaps.any() else len(later)
    found = np.zeros(len(pulses_s), bool)
    found[later[:end]] = True
    return found


def count_undriven(firmware: Records, pulses_s: FloatArray) -> int:
    """Number of pulses with the crank off for `PAUSE_S` or more."""
    driven_s = column(firmware, "t_s")[np.isin(column(firmware, "outputs.mode"), MOVING)]
    before = np.searchsorted(driven_s, pulses_s) - 1
    last_s = driven_s[np.maximum(before, 0)] if len(driven_s) else np.zeros(len(pulses_s))
    idle_s = np.where(before >= 0, pulses_s - last_s, pulses_s)
    return int(np.count_nonzero(idle_s >= PAUSE_S))


def gait_figures(traces: RunTraces, hold: Window | None) -> GaitFigures:
    """All figures of a walk over the hold; all None without a walk or a hold."""
    plant, firmware = traces.plant, traces.firmware
    if not traces.is_walked or len(plant) == 0 or hold is None:
        return no_figures(GaitFigures)
    t_s, error = phase_error(plant, firmware)
    error = error[hold.holds(t_s)]
    end = gait_end(plant, hold.start_s)
    steady = hold if end is None else Window(hold.start_s, min(hold.end_s, end.at_s))
    strikes = heel_strikes(plant)
    strikes = strikes[steady.holds(strikes)][SETTLING_STRIDES:]
    pulses = pulses_of(plant, traces.impacts)
    inside = push_off(traces.scenario).holds(pulses.phase)
    hits, misses = (impacts_by_period(pulses.t_s[among], strikes) for among in (inside, ~inside))
    after = hardest = None
    if end is not None:
        follows = is_following(pulses.t_s, end.at_s, next_start_s(firmware, end.at_s))
        before = (pulses.t_s >= steady.second_half().start_s) & (pulses.t_s <= end.at_s)
        after = float(pulses.t_s[follows][-1] - end.at_s) if follows.any() else 0.0
        if before.any():
            largest = float(np.max(pulses.v_m_s[follows], initial=0.0))
            hardest = largest / float(np.max(pulses.v_m_s[before]))
    return GaitFigures(
        phase_rmse_percent=100.0 * float(np.sqrt(np.mean(error**2))) if len(error) else None,
        phase_worst_percent=100.0 * float(np.max(np.abs(error))) if len(error) else None,
        strides=len(hits),
        in_window=float(np.mean(hits > 0)) if len(hits) else None,
        pulses_per_stride=float(np.mean(hits + misses)) if len(hits) else None,
        outside_per_stride=float(np.mean(misses)) if len(hits) else None,
        end=None if end is None else end.cause,
        end_s=None if end is None else end.at_s,
        last_pulse_after_s=after,
        hardest_after=hardest,
        undriven=count_undriven(firmware, pulses.t_s),
    )
