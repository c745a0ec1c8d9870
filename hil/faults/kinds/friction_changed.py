"""A guide with other friction."""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.friction import times
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Number


class FrictionChanged(PhysicalFault):
    """The guide has different friction."""

    is_steady: ClassVar[bool] = True
    kind: Literal["friction-changed"]
    factor: Number = Field(ge=0.0, le=1000.0, description="the new coefficients divided by the old ones")

    def parts(self, parts: Parts) -> Parts:
        """A guide with the new coefficients."""
        return parts._replace(friction=times(parts.friction, self.factor))

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """A factor that leaves the scene's friction as it is."""
        friction = scene.friction.part()
        if times(friction, self.factor) != friction:
            return None
        return f"factor = {self.factor:g} does not change the scene's friction; give the scene friction"
