"""Frames out of order."""

from typing import ClassVar, Literal

from firmware_py.interface.frame import Frame
from hil.faults.fault import Late
from hil.faults.on_bus import FramesFault, Step


class Reordered(FramesFault):
    """Frames of an identifier that change their order in pairs."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["reordered"]

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """An unpaired frame is held until the next one of its identifier comes."""
        waiting = {frame.can_id: frame for frame in self.released()}
        passed: list[Frame] = []
        for frame in frames:
            if frame.can_id not in self.can_ids:
                passed.append(frame)
            elif frame.can_id in waiting:
                passed += [frame, waiting.pop(frame.can_id)]
            else:
                waiting[frame.can_id] = frame
        self.memory.held.extend(Late(0.0, frame) for frame in waiting.values())
        self.count(len(self.named(frames)))
        return passed
