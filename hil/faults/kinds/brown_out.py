"""A drive without supply."""

from typing import ClassVar, Literal

from hil.drive.axis import DriveConfig
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.parts import Parts


class BrownOut(PhysicalFault):
    """The drive's electronics lose their supply, and restart at the fault's end."""

    cuts_supply: ClassVar[bool] = True
    kind: Literal["brown-out"]

    def changes(self, parts: Parts, config: DriveConfig) -> bool:
        """In every tick."""
        return True
