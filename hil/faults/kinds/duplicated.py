"""Frames that are repeated."""

from typing import Literal

import numpy as np
from pydantic import Field

from hil.faults.on_bus import FramesFault, Outgoing, Sending


class Duplicated(FramesFault):
    """Frames that are sent several times at once."""

    kind: Literal["duplicated"]
    copies: int = Field(default=2, ge=2, le=100, description="how many times each frame is sent")

    @property
    def most_copies(self) -> int:
        """The copies."""
        return self.copies

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """Each frame leaves several times."""
        sent = [
            one for one in sending.frames for _ in range(self.copies if one.can_id in self.can_ids else 1)
        ]
        return Outgoing(sent, sending.held, len(self.named(sending.frames)))
