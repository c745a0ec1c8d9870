"""An encoder whose magnet slips."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_sensor import TURN_RAD, Past, ReadingFault, shifted
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Turns


class EncoderSlip(ReadingFault):
    """The encoder's magnet slips on the shaft, once."""

    kind: Literal["encoder-slip"]
    slip_rev: Turns = Field(ge=-0.5, le=0.5, description="the angle of the slip, in revolutions")

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The angle with the slip."""
        return shifted(reading, "encoder", self.slip_rev * TURN_RAD)

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No change."""
        return "it changes nothing; give another value" if self.slip_rev == 0.0 else None
