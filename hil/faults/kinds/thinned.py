"""Frames at a lower rate."""

from typing import Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Step, periods_begun
from plant_sim.tables.quantities import Duration


class Thinned(FramesFault):
    """Frames at a lower rate: the frames in between never leave their sender."""

    kind: Literal["thinned"]
    period_s: Duration = Field(gt=0.0, le=10.0, description="the time between two frames that leave, in s")

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Frames leave in steps in which a period begins."""
        if periods_begun(self.at_s, self.period_s, step) > 0:
            return frames
        left = self.others(frames)
        self.count(len(frames) - len(left))
        return left
