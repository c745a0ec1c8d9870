"""Frames that are late."""

from typing import ClassVar, Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.fault import TIME_RESOLUTION_S, Late
from hil.faults.on_bus import FramesFault, Step
from plant_sim.tables.quantities import Duration


class Delayed(FramesFault):
    """Frames that are delayed by a constant time."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["delayed"]
    delay_s: Duration = Field(gt=0.0, description="the delay, in s")

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Frames are held until they are due; a frame that leaves in its own step is not delayed."""
        named, held = self.named(frames), self.memory.held
        held.extend(Late(step.t_s + self.delay_s, one) for one in named)
        if self.delay_s > TIME_RESOLUTION_S:
            self.count(len(named))
        due = []
        while held and held[0].due_s <= step.t_s + TIME_RESOLUTION_S:
            due.append(held.popleft().frame)
        return [*due, *self.others(frames)]
