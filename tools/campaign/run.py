"""Run a scenario in closed loop and keep its impacts, detections and modes for the judges."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.builds import Build
from hil.record.traces.plant_trace import PlantRecord
from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.scenario import Scenario
from plant_sim.arrays import FloatArray
from plant_sim.parts.parts import Parts
from plant_sim.result import Impact

SIGNALS = (
    "outputs.mode",
    "outputs.fault",
    "outputs.refusal",
    "outputs.regime",
    "outputs.impact",
    "outputs.impact_age_s",
    "outputs.impact_speed_m_s",
    "outputs.period_ended",
    "outputs.torque_n_m",
    "state.estimator.x_m",
    "state.estimator.v_m_s",
    "state.estimator.nis",
    "state.gait.phase",
)
"""Signals of the firmware that are kept in every tick for the judges."""
EVENTS = ("outputs.impact", "outputs.period_ended")
"""Those that are true in the tick of an event alone."""


class ModeChange(NamedTuple):
    """Time at which the firmware entered a mode, s, and the fault that it reported in this tick."""

    t_s: float
    mode: Mode
    fault: Fault


@dataclass(frozen=True)
class Run:
    """A finished run: the truth and the firmware's kept signals, a record a tick each, and the true impacts.

    `plant`: records with the columns of `PlantRecord`. `impacts`: as `Impact`, oldest first.
    """

    parts: Parts
    tick_s: float
    plant: NDArray[np.void]
    firmware: NDArray[np.void]
    impacts: NDArray[np.void]

    def true(self, name: str) -> FloatArray:
        """Return a column of the truth by its name in `PlantRecord`, shape (ticks,)."""
        return np.asarray(self.plant[name], np.float64)

    @cached_property
    def modes(self) -> list[ModeChange]:
        """All changes of mode since power-up."""
        modes = self.firmware["outputs.mode"]
        changes = np.flatnonzero(np.diff(modes, prepend=Mode.INIT.value))
        faults = self.firmware["outputs.fault"]
        return [ModeChange(float(k) * self.tick_s, Mode(modes[k]), Fault(faults[k])) for k in changes]

    def first_in(self, mode: Mode) -> ModeChange | None:
        """Return the first change into a mode; None if there is none."""
        return next((change for change in self.modes if change.mode == mode), None)

    @property
    def last_word(self) -> str:
        """The last mode, since when it lasts, and its fault, as text."""
        if not self.modes:
            return "never ready"
        last = self.modes[-1]
        fault = f", {last.fault.name.lower()}" if last.fault != Fault.NONE else ""
        return f"{last.mode.name.lower()} since {last.t_s:.2f} s{fault}"

    @cached_property
    def detections(self) -> NDArray[np.void]:
        """Records of the ticks in which the firmware has detected an impact."""
        records: NDArray[np.void] = self.firmware[self.firmware["outputs.impact"]]
        return records

    @cached_property
    def detected_s(self) -> FloatArray:
        """Times of these ticks, s: the firmware's tick is half a period after the plant's."""
        ticks: FloatArray = np.flatnonzero(self.firmware["outputs.impact"]).astype(np.float64)
        return (ticks + 0.5) * self.tick_s

    @cached_property
    def turns_s(self) -> FloatArray:
        """Times at which the true crank angle passed 0, s."""
        passed = (np.diff(self.true("crank_rad")) < 0.0) & (self.true("omega_rad_s")[1:] > 0.0)
        ticks: FloatArray = np.flatnonzero(passed).astype(np.float64)
        return (ticks + 1.0) * self.tick_s


class TickedRows:
    """The records of a trace at their ticks; a tick in which the node did not run repeats those before."""

    def __init__(self, ticks: int) -> None:
        self._has_run = np.zeros(ticks, bool)
        self._rows: NDArray[np.void] | None = None

    def add(self, records: NDArray[np.void]) -> None:
        """Place records."""
        if self._rows is None:
            self._rows = np.zeros(len(self._has_run), records.dtype)
        ticks = records["tick"].copy()
        first = int(ticks[0]) if len(ticks) else 0
        end = first + len(ticks)
        if end <= len(self._rows) and np.array_equal(ticks, np.arange(first, end)):
            # As bytes: numpy copies records column by column.
            self._rows[first:end].view(np.uint8)[:] = records.view(np.uint8)
        else:
            is_within = ticks < len(self._rows)  # a clock that is ahead passes the end
            ticks = ticks[is_within]
            self._rows[ticks] = records[is_within]
        self._has_run[ticks] = True

    def rows(self) -> NDArray[np.void]:
        """A record for each tick."""
        assert self._rows is not None
        if np.all(self._has_run):
            return self._rows
        last = np.maximum.accumulate(np.where(self._has_run, np.arange(len(self._has_run)), 0))
        repeated: NDArray[np.void] = self._rows[last]
        for name in set(EVENTS) & set(repeated.dtype.names or ()):
            repeated[name][~self._has_run] = False
        return repeated


def run(scenario: Scenario, seed: int, more: Sequence[str] = (), firmware: Build = "compiled") -> Run:
    """Run a scenario from power-up on; `more` names signals to keep in addition to `SIGNALS`."""
    kept = {"plant": PlantRecord._fields, "impacts": Impact._fields, "firmware": (*SIGNALS, *more)}
    plant, known = TickedRows(scenario.ticks), TickedRows(scenario.ticks)
    impacts: list[NDArray[np.void]] = []
    for segment in segments(Job(scenario, seed, firmware, kept=kept)):
        plant.add(segment.rows["plant"])
        known.add(segment.rows["firmware"])
        impacts.append(segment.rows["impacts"].copy())
    found = np.concatenate(impacts)
    return Run(
        scenario.scene.parts(seed),
        scenario.period_s,
        plant.rows(),
        known.rows(),
        found[np.argsort(found["t_s"], kind="stable")],
    )
