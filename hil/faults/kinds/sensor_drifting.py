"""A sensor that drifts."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr

from hil.faults.fault import Fault
from hil.faults.on_sensor import Past, SensorFault, shifted
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Number


class SensorDrifting(SensorFault):
    """An error that grows from 0 at a constant rate: of accelerations, or of the encoder's angle."""

    kind: Literal["sensor-drifting"]
    rate: Number = Field(description="the rate, in m/s² or rad per second")

    _error: float = PrivateAttr()

    def begin(self, noise: np.random.Generator) -> None:
        """Begin anew, as in a process that starts: without an error."""
        super().begin(noise)
        self._error = 0.0

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading with the present error."""
        self._error += self.rate * past.elapsed_s
        return shifted(reading, self.sensor, self._error)

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No change."""
        return "it changes nothing; give another rate" if self.rate == 0.0 else None
