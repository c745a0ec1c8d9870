"""A sensor with the wrong sign."""

from typing import Literal

from hil.faults.on_sensor import Past, SensorFault
from plant_sim.sensors.readings import SensorReading


class SensorWrongSign(SensorFault):
    """A sensor mounted the wrong way round."""

    kind: Literal["sensor-wrong-sign"]

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading with the other sign."""
        turned = reading._replace(**{name: -getattr(reading, name) for name in self.fields})
        return turned._replace(encoder_position_rev=turned.encoder_position_rev % 1.0)
