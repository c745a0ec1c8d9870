"""Frames with wrong bits."""

from typing import Literal

import numpy as np

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import FramesFault, Share, Step


class Corrupted(FramesFault):
    """Frames with some inverted bits in one byte, not detected by the CAN controller's own checksum."""

    kind: Literal["corrupted"]
    share: Share = 1.0

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """Frames of the given share have a wrong byte."""
        noise = self.memory.noise
        hit = [one.can_id in self.can_ids and noise.random() < self.share for one in frames]
        sent = [broken(one, noise) if is_hit else one for one, is_hit in zip(frames, hit, strict=True)]
        self.count(sum(one != other for one, other in zip(frames, sent, strict=True)))
        return sent


def broken(frame: Frame, noise: np.random.Generator) -> Frame:
    """The frame with some bits of one byte inverted; a frame without data is unchanged."""
    if not frame.data:
        return frame
    place, pattern = int(noise.integers(len(frame.data))), int(noise.integers(1, 256))
    data = bytearray(frame.data)
    data[place] ^= pattern
    return Frame(frame.can_id, bytes(data))
