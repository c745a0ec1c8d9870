"""A kick to the striker."""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_plant import PhysicalFault
from plant_sim.plant import Plant
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Speed


class Kick(PhysicalFault):
    """An impulse from outside changes the striker's velocity, once."""

    is_steady: ClassVar[bool] = True
    kind: Literal["kick"]
    change_m_s: Speed = Field(description="the change of velocity in m/s, positive towards the stop")

    @property
    def interval_s(self) -> tuple[float, float]:
        """An instant."""
        return self.at_s, self.at_s

    def strike(self, plant: Plant, powered_up_s: float) -> None:
        """Kick the striker; a plant that is powered up later is not kicked."""
        if self.at_s > powered_up_s - TIME_RESOLUTION_S:
            plant.kick(self.change_m_s)
            self.count()

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No change."""
        return "it changes nothing; give another value" if self.change_m_s == 0.0 else None
