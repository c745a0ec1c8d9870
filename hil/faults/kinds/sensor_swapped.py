"""Two accelerometers that are swapped."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_sensor import FIELDS, Past, ReadingFault
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading

Channel = Literal["striker-low", "striker-high", "housing"]


class SensorSwapped(ReadingFault):
    """Two accelerometer channels that carry each other's readings."""

    kind: Literal["sensor-swapped"]
    sensors: list[Channel] = Field(
        min_length=2, max_length=2, description="the two channels: striker-low, striker-high or housing"
    )

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading with the two values exchanged."""
        first, second = (FIELDS[name][0] for name in self.sensors)
        return reading._replace(**{first: getattr(reading, second), second: getattr(reading, first)})

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No change."""
        return "it changes nothing; name two channels" if len(set(self.sensors)) < len(self.sensors) else None
