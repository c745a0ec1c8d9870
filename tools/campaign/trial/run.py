"""One closed loop from Python: a scenario in; impacts, detections and modes out."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.enums import Fault, Mode
from hil.bench.stretches import records_of
from hil.record.traces.firmware_trace import columns_of
from hil.record.traces.plant_trace import PlantRecord
from hil.scenario.scenario import Scenario
from plant_sim.arrays import FloatArray
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
    "state.estimator.x_m",
    "state.estimator.v_m_s",
    "state.estimator.nis",
    "state.gait.phase",
)
"""What is kept of the firmware in every tick, for the judges."""


class ModeChange(NamedTuple):
    """When the firmware went into a mode, s, and the fault it reported then."""

    t_s: float
    mode: Mode
    fault: Fault


@dataclass(frozen=True)
class Run:
    """What happened: a row a tick of the truth and of what was kept of the firmware, and the true impacts.

    Impacts: columns (t_s, v, v after, impulse, peak force, crank angle), shape (n, 6), oldest first.
    """

    parts: Parts
    tick_s: float
    plant: FloatArray
    firmware: NDArray[np.void]
    impacts: FloatArray

    def true(self, name: str) -> FloatArray:
        """A column of the truth by its name in `PlantRecord`, shape (ticks,)."""
        return self.plant[:, PlantRecord._fields.index(name)]

    @cached_property
    def modes(self) -> list[ModeChange]:
        """Every change of mode since power-up."""
        modes = self.firmware["outputs.mode"]
        changes = np.flatnonzero(np.diff(modes, prepend=Mode.INIT.value))
        faults = self.firmware["outputs.fault"]
        return [ModeChange(float(k) * self.tick_s, Mode(modes[k]), Fault(faults[k])) for k in changes]

    def first_in(self, mode: Mode) -> ModeChange | None:
        """The first change into a mode."""
        return next((change for change in self.modes if change.mode == mode), None)

    @cached_property
    def detections(self) -> NDArray[np.void]:
        """The firmware's records of ticks in which it has detected an impact."""
        records: NDArray[np.void] = self.firmware[self.firmware["outputs.impact"]]
        return records

    @cached_property
    def detected_s(self) -> FloatArray:
        """When it did."""
        ticks: FloatArray = np.flatnonzero(self.firmware["outputs.impact"]).astype(np.float64)
        return (ticks + 0.5) * self.tick_s

    @cached_property
    def turns_s(self) -> FloatArray:
        """When the true crank passed 0."""
        passed = (np.diff(self.true("crank_rad")) < 0.0) & (self.true("omega_rad_s")[1:] > 0.0)
        ticks: FloatArray = np.flatnonzero(passed).astype(np.float64)
        return (ticks + 1.0) * self.tick_s


def run(scenario: Scenario, seed: int, more: Sequence[str] = ()) -> Run:
    """Run a scenario from power-up on; `more` of the firmware's signals are kept beside `SIGNALS`."""
    columns = columns_of([*SIGNALS, *more])
    plant = np.empty((scenario.ticks, len(PlantRecord._fields)))
    firmware = np.empty(scenario.ticks, columns)
    impacts: list[FloatArray] = []
    tick = 0
    for records in records_of(scenario, seed, columns):
        ticks = slice(tick, tick + len(records.plant))
        plant[ticks], firmware[ticks] = records.plant, records.firmware
        impacts.append(records.impacts.copy())
        tick = ticks.stop
    together: Any = np.concatenate(impacts)
    return Run(
        scenario.scene.parts(seed),
        scenario.period_s,
        plant,
        firmware,
        together[np.argsort(together[:, 0], kind="stable")],
    )
