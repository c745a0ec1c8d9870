"""A sensor with a bias."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_sensor import Past, SensorFault, shifted
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Number


class SensorBiased(SensorFault):
    """An additional constant: of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-biased"]
    bias: Number = Field(description="the constant, in m/s² or rad")

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading with the constant."""
        return shifted(reading, self.sensor, self.bias)

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No change."""
        return "it changes nothing; give another value" if self.bias == 0.0 else None
