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
        named, held = self.named(sending.frames), sending.held
        held.extend(Late(sending.step.t_s + self.delay_s, one) for one in named)
        due = []
        while held and held[0].due_s <= sending.step.t_s + TIME_RESOLUTION_S:
            due.append(held.popleft().frame)
        return Outgoing([*due, *self.others(sending.frames)], held, len(named))
