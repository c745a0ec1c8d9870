"""Frames that come in bundles."""

from typing import ClassVar, Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.fault import Late
from hil.faults.on_bus import FramesFault, Step, periods_begun
from plant_sim.tables.quantities import Duration


class Bundled(FramesFault):
    """Frames that wait and arrive in bundles, as from a USB adapter with a latency timer or a gateway."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["bundled"]
    period_s: Duration = Field(gt=0.0, le=1.0, description="the time from one bundle to the next, in s")

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Frames are held until the next bundle leaves; those of the step in which it leaves are not late."""
        named, others = self.named(frames), self.others(frames)
        self.memory.held.extend(Late(step.t_s, one) for one in named)
        if periods_begun(self.at_s, self.period_s, step) > 0:
            return [*self.released(), *others]
        self.count(len(named))
        return others
