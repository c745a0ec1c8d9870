"""A stop that moves."""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.fault import Fault
from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Length


class StopMoved(PhysicalFault):
    """The stop is shifted."""

    is_steady: ClassVar[bool] = True
    kind: Literal["stop-moved"]
    by_m: Length = Field(ge=-0.2, le=0.2, description="the shift in m, positive away from the drive")

    def parts(self, parts: Parts) -> Parts:
        """A stop at the new position."""
        stop = parts.stop
        if isinstance(stop, NoStop):
            return parts
        return parts._replace(stop=stop._replace(position_m=stop.position_m + self.by_m))

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """A scene without a stop, or no shift."""
        if scene.stop.law == "none":
            return "the scene has no stop; give it one, or leave the fault out"
        return "it changes nothing; give another value" if self.by_m == 0.0 else None
