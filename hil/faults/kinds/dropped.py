"""Frames that are lost."""

from typing import Literal

import numpy as np

from hil.faults.on_bus import FramesFault, Outgoing, Sending, Share


class Dropped(FramesFault):
    """Frames that never leave their sender."""

    kind: Literal["dropped"]
    share: Share = 1.0

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """Frames of the given share are gone."""
        left = [
            one for one in sending.frames if one.can_id not in self.can_ids or noise.random() >= self.share
        ]
        return Outgoing(left, sending.held, len(sending.frames) - len(left))
