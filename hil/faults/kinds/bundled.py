"""Frames that come in bundles."""

from collections import deque
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hil.faults.on_bus import FramesFault, Late, Outgoing, Sending, periods_begun


class Bundled(FramesFault):
    """Frames that wait and arrive in bundles, as from a USB adapter with a latency timer or a gateway."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["bundled"]
    period_s: float = Field(gt=0.0, le=1.0, description="the time from one bundle to the next, in s")

    @property
    def longest_hold_s(self) -> float:
        """The time between two bundles."""
        return self.period_s

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """Frames are held until the next bundle leaves."""
        named, others = self.named(sending.frames), self.others(sending.frames)
        bundle = sending.held
        bundle.extend(Late(sending.step.t_s, one) for one in named)
        if periods_begun(self.at_s, self.period_s, sending.step) > 0:
            return Outgoing([*(late.frame for late in bundle), *others], deque(), len(named))
        return Outgoing(others, bundle, len(named))
