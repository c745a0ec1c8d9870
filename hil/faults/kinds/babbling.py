"""A foreign node that repeats one frame."""

from typing import ClassVar, Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import LineFault, Step, periods_begun
from plant_sim.tables.quantities import Duration


class Babbling(LineFault):
    """A foreign node that sends one frame again and again."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["babbling"]
    can_id: int = Field(ge=0, le=0x7FF, description="the frame's identifier")
    data_hex: str = Field(
        default="", pattern="^([0-9a-fA-F]{2}){0,8}$", description="the frame's data in hex"
    )
    period_s: Duration = Field(ge=2e-5, description="the time between two frames, in s")

    @property
    def frame(self) -> Frame:
        """The frame that is sent."""
        return Frame(self.can_id, bytes.fromhex(self.data_hex))

    def foreign_frames(self, step: Step) -> list[Frame]:
        """One frame for each period that begins."""
        return [self.frame] * periods_begun(self.at_s, self.period_s, step)
