"""Frames of the bus as numbers of compiled code, and back."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of


def word_frame(frame: Frame) -> WordFrame:
    """Convert a frame of the bus to a frame of the compiled code."""
    return WordFrame(frame.can_id, len(frame.data), word_of(frame.data))


def byte_frame(can_id: int, length: int, word: int) -> Frame:
    """Convert a frame of the compiled code to a frame of the bus."""
    return Frame(can_id, bytes_of(word, length))


def frames_in(rows: NDArray[np.int64]) -> list[Frame]:
    """The frames in rows of identifier, length and word, without empty rows."""
    return [byte_frame(*row) for row in rows.tolist() if row[0] != 0]


def put_frames(rows: NDArray[np.int64], first: int, frames: Sequence[Frame]) -> int:
    """Put frames into rows of identifier, length and word from `first` on; return the end."""
    end = first + len(frames)
    if frames:
        rows[first:end] = [word_frame(frame) for frame in frames]
    return end
