"""Frames out of order."""

from collections import deque
from typing import ClassVar, Literal

import numpy as np

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Late, Outgoing, Sending


class Reordered(FramesFault):
    """Frames of an identifier that change their order in pairs."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["reordered"]

    def outgoing(self, sending: Sending, noise: np.random.Generator) -> Outgoing:
        """An unpaired frame is held until the next one of its identifier comes."""
        waiting = {late.frame.can_id: late.frame for late in sending.held}
        passed: list[Frame] = []
        for frame in sending.frames:
            if frame.can_id not in self.can_ids:
                passed.append(frame)
            elif frame.can_id in waiting:
                passed += [frame, waiting.pop(frame.can_id)]
            else:
                waiting[frame.can_id] = frame
        later = deque(Late(0.0, frame) for frame in waiting.values())
        return Outgoing(passed, later, len(self.named(sending.frames)))
