"""A sensor with a loose contact."""

from typing import Literal

from hil.faults.on_bus import Share
from hil.faults.on_sensor import Past, SensorFault
from plant_sim.sensors.readings import SensorReading


class SensorIntermittent(SensorFault):
    """Readings that are 0 now and then, as with a loose contact."""

    kind: Literal["sensor-intermittent"]
    share: Share = 0.5

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading, or 0 for the given share of readings."""
        if self.memory.noise.random() >= self.share:
            return reading
        return reading._replace(**dict.fromkeys(self.fields, 0.0))
