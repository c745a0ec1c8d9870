"""Frames that are lost."""

from typing import Literal

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Share, Step


class Dropped(FramesFault):
    """Frames that never leave their sender."""

    kind: Literal["dropped"]
    share: Share = 1.0

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Frames of the given share are gone."""
        noise = self.memory.noise
        left = [one for one in frames if one.can_id not in self.can_ids or noise.random() >= self.share]
        self.count(len(frames) - len(left))
        return left
