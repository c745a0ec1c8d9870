"""Run a scenario in closed loop and keep its impacts, detections and modes for the judges."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.builds import NATIVE, Build
from hil.bench.lockstep import run_lockstep
from hil.bench.stretches import records_of
from hil.record.traces.firmware_trace import columns_of
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.trace import read
from hil.scenario.scenario import Scenario
from plant_sim.arrays import FloatArray
from plant_sim.kernels import IS_INTERPRETED
from plant_sim.parts.parts import Parts

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
Kept = tuple[FloatArray, NDArray[np.void], NDArray[np.void]]
"""The truth and the kept signals of the firmware, a row a tick each, and the true impacts."""


class ModeChange(NamedTuple):
    """Time at which the firmware entered a mode, s, and the fault that it reported in this tick."""

    t_s: float
    mode: Mode
    fault: Fault


@dataclass(frozen=True)
class Run:
    """A finished run: the truth and the firmware's kept signals, a row a tick each, and the true impacts.

    Impacts: records as `Impact`, oldest first.
    """

    parts: Parts
    tick_s: float
    plant: FloatArray
    firmware: NDArray[np.void]
    impacts: NDArray[np.void]

    def true(self, name: str) -> FloatArray:
        """Return a column of the truth by its name in `PlantRecord`, shape (ticks,)."""
        return self.plant[:, PlantRecord._fields.index(name)]

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


def run(scenario: Scenario, seed: int, more: Sequence[str] = (), firmware: Build = "compiled") -> Run:
    """Run a scenario from power-up on; `more` names signals to keep in addition to `SIGNALS`."""
    is_steady = all(fault.is_steady for fault in scenario.faults)
    is_compiled = firmware in NATIVE and not IS_INTERPRETED
    kept = run_in_stretches if is_compiled and is_steady else run_in_a_folder
    plant, known, impacts = kept(scenario, seed, columns_of([*SIGNALS, *more]), firmware)
    return Run(
        scenario.scene.parts(seed),
        scenario.period_s,
        plant,
        known,
        impacts[np.argsort(impacts["t_s"], kind="stable")],
    )


def run_in_stretches(scenario: Scenario, seed: int, columns: Any, firmware: Build) -> Kept:
    """Run the scenario in the compiled closed loop, without a run folder."""
    plant = np.empty((scenario.ticks, len(PlantRecord._fields)))
    known = np.empty(scenario.ticks, columns)
    impacts: list[NDArray[np.void]] = []
    tick = 0
    for records in records_of(scenario, seed, columns, firmware):
        ticks = slice(tick, tick + len(records.plant))
        plant[ticks], known[ticks] = records.plant, records.firmware
        impacts.append(records.impacts.copy())
        tick = ticks.stop
    return plant, known, np.concatenate(impacts)


def run_in_a_folder(scenario: Scenario, seed: int, columns: Any, firmware: Build) -> Kept:
    """Run the scenario in lockstep and read its traces."""
    with tempfile.TemporaryDirectory() as folder:
        run_lockstep(scenario, Path(folder), seed, lambda *_: None, firmware)
        plant, traced, impacts = (
            read(Path(folder) / f"{name}.trace") for name in ("plant", "firmware", "impacts")
        )
    known = np.zeros(len(traced), columns)
    for name in columns.names:
        if name in (traced.dtype.names or ()):  # a run without a walker records no gait
            known[name] = traced[name]
    truth = structured_to_unstructured(plant[list(PlantRecord._fields)], np.float64)
    return truth, known, impacts
