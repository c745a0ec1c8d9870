"""Frames at a lower rate."""

from typing import Literal

import numpy as np
from pydantic import Field

from hil.faults.on_bus import FramesFault, Outgoing, Sending, periods_begun


class Thinned(FramesFault):
    """Frames at a lower rate: the frames in between never leave their sender."""

    kind: Literal["thinned"]
    period_s: float = Field(gt=0.0, le=10.0, description="the time between two frames that leave, in s")

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """Frames leave in steps in which a period begins."""
        if periods_begun(self.at_s, self.period_s, sending.step) > 0:
            return Outgoing(list(sending.frames), sending.held, 0)
        left = self.others(sending.frames)
        return Outgoing(left, sending.held, len(sending.frames) - len(left))
