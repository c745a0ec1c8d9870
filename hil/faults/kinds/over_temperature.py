"""A winding that is too hot."""

from typing import Literal

from pydantic import Field

from hil.drive.axis import DriveConfig, DriveState
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.parts import Parts
from plant_sim.tables.quantities import Temperature


class OverTemperature(PhysicalFault):
    """The winding is held at a temperature."""

    kind: Literal["over-temperature"]
    motor_degc: Temperature = Field(description="the winding's temperature, in °C")

    def drive(self, drive: DriveState) -> DriveState:
        """The drive with the winding at the temperature."""
        return drive._replace(motor_degc=self.motor_degc)

    def changes(self, parts: Parts, config: DriveConfig) -> bool:
        """In every tick."""
        return True
