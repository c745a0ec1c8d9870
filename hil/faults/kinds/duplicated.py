"""Frames that are repeated."""

from typing import Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Step


class Duplicated(FramesFault):
    """Frames that are sent several times at once."""

    kind: Literal["duplicated"]
    copies: int = Field(default=2, ge=2, le=100, description="how many times each frame is sent")

    @property
    def most_copies(self) -> int:
        """The copies of a frame."""
        return self.copies

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Each frame leaves several times."""
        self.count(len(self.named(frames)))
        return [one for one in frames for _ in range(self.copies if one.can_id in self.can_ids else 1)]
