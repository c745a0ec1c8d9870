"""A sensor with more noise."""

from typing import Literal

from pydantic import Field

from hil.faults.on_sensor import Past, SensorFault, shifted
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Number


class SensorNoisy(SensorFault):
    """Additional normal noise: of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-noisy"]
    std: Number = Field(gt=0.0, description="the noise's standard deviation, in m/s² or rad")

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading with noise."""
        return shifted(reading, self.sensor, self.std * float(self.memory.noise.standard_normal()))
