"""A clock that jumps."""

from typing import Literal

from pydantic import Field

from hil.faults.on_process import ClockFault
from hil.roster import FIRMWARE
from plant_sim.tables.quantities import Duration


class ClockJumped(ClockFault):
    """The controller's clock jumps once while the controller runs."""

    kind: Literal["clock-jumped"]
    by_s: Duration = Field(ge=-10.0, le=10.0, description="the change in s, positive forwards")

    def faulty_process(self) -> str:
        """The controller."""
        return FIRMWARE

    @property
    def ahead_s(self) -> float:
        """The jump."""
        return self.by_s
