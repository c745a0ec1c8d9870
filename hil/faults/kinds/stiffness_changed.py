"""A spring with another stiffness."""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Number


class StiffnessChanged(PhysicalFault):
    """The coupling spring has a different stiffness."""

    is_steady: ClassVar[bool] = True
    kind: Literal["stiffness-changed"]
    factor: Number = Field(gt=0.0, le=10.0, description="the new stiffness divided by the old one")

    def parts(self, parts: Parts) -> Parts:
        """A striker with the new stiffness."""
        striker = parts.striker
        return parts._replace(striker=striker._replace(spring_n_per_m=self.factor * striker.spring_n_per_m))

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """A factor of 1."""
        return "it changes nothing; give another value" if self.factor == 1.0 else None
