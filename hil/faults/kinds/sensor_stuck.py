"""A sensor that is stuck."""

from typing import Literal

from hil.faults.on_sensor import Past, SensorFault
from plant_sim.sensors.readings import SensorReading


class SensorStuck(SensorFault):
    """A sensor that repeats its last reading."""

    kind: Literal["sensor-stuck"]

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The last reading before the fault."""
        return reading._replace(**{name: getattr(past.before, name) for name in self.fields})
