"""Frames that are late."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hil.faults.on_bus import TIME_RESOLUTION_S, FramesFault, Late, Outgoing, Sending


class Delayed(FramesFault):
    """Frames that are delayed by a constant time."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["delayed"]
    delay_s: float = Field(gt=0.0, description="the delay, in s")

    @property
    def longest_hold_s(self) -> float:
        """The delay; at its end the fault holds no frame."""
        return min(self.delay_s, self.end_s - self.at_s)

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """Frames are held until they are due."""
        named = self.named(sending.frames)
        late = (*sending.held, *(Late(sending.step.t_s + self.delay_s, one) for one in named))
        due = [one for due_s, one in late if due_s <= sending.step.t_s + TIME_RESOLUTION_S]
        return Outgoing([*due, *self.others(sending.frames)], late[len(due) :], len(named))
