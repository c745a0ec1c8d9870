"""Frames that no longer change."""

from typing import Literal

import numpy as np
from pydantic import PrivateAttr

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Step


class Frozen(FramesFault):
    """A sender that repeats the first frame of each name that it sends within the fault, counter included.

    A sensor that repeats its reading in new frames is `sensor-stuck`.
    """

    kind: Literal["frozen"]

    _first: dict[int, Frame] = PrivateAttr()

    def begin(self, noise: np.random.Generator) -> None:
        """Begin anew, as in a process that starts: nothing is repeated yet."""
        super().begin(noise)
        self._first = {}

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """The named frames as they were first sent."""
        self.count(sum(frame.can_id in self._first for frame in frames if frame.can_id in self.can_ids))
        return [
            self._first.setdefault(frame.can_id, frame) if frame.can_id in self.can_ids else frame
            for frame in frames
        ]
