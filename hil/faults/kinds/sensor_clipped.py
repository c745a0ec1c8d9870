"""A sensor that clips."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_sensor import Past, SensorFault
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Acceleration


class SensorClipped(SensorFault):
    """Accelerations that are clipped at a limit."""

    kind: Literal["sensor-clipped"]
    limit_m_s2: Acceleration = Field(gt=0.0, description="the largest reading, in m/s²")

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading within the limit."""
        limit = self.limit_m_s2
        return reading._replace(
            **{name: min(max(getattr(reading, name), -limit), limit) for name in self.fields}
        )

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """The encoder has no acceleration."""
        if self.sensor != "encoder":
            return None
        return "it clips accelerations, and the encoder measures an angle; name an accelerometer"
