"""A supply with another voltage."""

from typing import ClassVar, Literal

from pydantic import Field

from hil.drive.axis import DriveConfig
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.tables.quantities import Voltage


class SupplySag(PhysicalFault):
    """The supply has a different voltage."""

    is_steady: ClassVar[bool] = True
    kind: Literal["supply-sag"]
    supply_v: Voltage = Field(gt=0.0, le=60.0, description="the supply's voltage, in V")

    def parts(self, parts: Parts) -> Parts:
        """A motor at this voltage."""
        if not isinstance(parts.drive, MotorDrive):
            return parts
        return parts._replace(drive=parts.drive._replace(supply_v=self.supply_v))

    def config(self, config: DriveConfig) -> DriveConfig:
        """A drive at this voltage."""
        return config._replace(supply_v=self.supply_v)
