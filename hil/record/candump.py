"""Parses candump's log lines, `(seconds.micros) channel ID#DATA`, in blocks of lines."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray, IntArray

LINE = re.compile(rb"\((\d{1,12}\.\d{6,9})\) \S+ ([0-9A-Fa-f]{1,8})#((?:[0-9A-Fa-f]{2}){0,64})\r?\n")
BLOCK_BYTES = 1 << 23
"""Block size: some two hundred thousand lines, of a minute."""
LONGEST_LINE_BYTES = 1 << 10
"""Largest part of an unfinished line that is kept; limits the memory for a file without line ends."""
TENTH_S = 0.1
"""Averaging time of the load over time: the period of the slowest cyclic frames."""
TIME_RESOLUTION_S = 1e-6
"""Resolution of candump's times."""
MOST_BYTES = 8
"""Largest number of data bytes of a classic CAN frame."""


class Bus(ABC):
    """The frames of a run, in memory or on disk."""

    @abstractmethod
    def pieces(self) -> Iterator["BusLog"]:
        """The frames in pieces."""

    @cached_property
    def counts(self) -> "BusCounts":
        """The number of frames in each tenth of a second."""
        return counted(self.pieces())

    def whole(self) -> "BusLog":
        """All frames in memory."""
        return joined_logs(self.pieces())


@dataclass(frozen=True)
class BusLog(Bus):
    """Frames: simulated seconds, identifiers, lengths in bytes, shapes (n,); and their concatenated bytes."""

    t_s: FloatArray
    can_id: IntArray
    length: IntArray
    content: bytes

    @cached_property
    def starts(self) -> IntArray:
        """Offset of each frame's bytes."""
        starts: IntArray = np.cumsum(self.length) - self.length
        return starts

    def payloads_of(self, rows: IntArray) -> list[bytes]:
        """The bytes of some frames."""
        places = zip(self.starts[rows].tolist(), self.length[rows].tolist(), strict=True)
        return [self.content[start : start + length] for start, length in places]

    @property
    def payloads(self) -> tuple[bytes, ...]:
        """The bytes of each frame."""
        return tuple(self.payloads_of(np.arange(len(self.t_s))))

    def pieces(self) -> Iterator["BusLog"]:
        """Yield all frames as one piece."""
        yield self

    def whole(self) -> "BusLog":
        """All frames, which are already in memory."""
        return self


class BusCounts(NamedTuple):
    """Numbers of frames and bytes in each tenth of a second with frames; shapes (tenths,).

    `tenth`: number of the tenth. `lines` and `read_bytes`: size of the file, 0 without a file.
    """

    tenth: IntArray
    frames: IntArray
    frame_bytes: IntArray
    lines: int = 0
    read_bytes: int = 0

    @property
    def total(self) -> int:
        """Number of frames."""
        return int(self.frames.sum())


def tenths_of(bus: BusLog) -> IntArray:
    """Number of the tenth of a second of each frame."""
    return np.floor((bus.t_s + TIME_RESOLUTION_S) / TENTH_S).astype(np.int64)


def counted(pieces: Iterable[BusLog]) -> BusCounts:
    """Count the frames of all pieces."""
    found: dict[int, tuple[int, int]] = {}
    for bus in pieces:
        tenths, row = np.unique(tenths_of(bus), return_inverse=True)
        frames = np.bincount(row, minlength=len(tenths))
        sent = np.bincount(row, weights=bus.length, minlength=len(tenths)).astype(np.int64)
        for tenth, *more in zip(tenths.tolist(), frames.tolist(), sent.tolist(), strict=True):
            before = found.get(tenth, (0, 0))
            found[tenth] = (before[0] + more[0], before[1] + more[1])
    rows = np.array([(tenth, *found[tenth]) for tenth in sorted(found)], np.int64).reshape(-1, 3)
    return BusCounts(*rows.T)


NO_BUS = BusLog(np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), b"")


def joined_logs(pieces: Iterable[BusLog]) -> BusLog:
    """All pieces as one log."""
    parts = [NO_BUS, *pieces]
    return BusLog(
        t_s=np.concatenate([part.t_s for part in parts]),
        can_id=np.concatenate([part.can_id for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        content=b"".join(part.content for part in parts),
    )


class StoredBus(Bus):
    """The frames of a candump log on disk, read in blocks; those of a log of one block are kept."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines = self._read_bytes = 0
        self._kept: BusLog | None = None

    def pieces(self) -> Iterator[BusLog]:
        """The frames in pieces."""
        if self._kept is not None:
            yield self._kept
            return
        self._lines = self._read_bytes = 0
        only: BusLog | None = None
        with self._path.open("rb") as file:
            left = b""
            while block := file.read(BLOCK_BYTES):
                self._read_bytes += len(block)
                self._lines += block.count(b"\n")
                text = left + block
                end = text.rfind(b"\n") + 1
                left = text[end:][-LONGEST_LINE_BYTES:]
                bus = parse_candump(text[:end])
                only = bus if self._read_bytes == len(block) else None
                yield bus
        self._kept = only

    @cached_property
    def counts(self) -> BusCounts:
        """Counts of the file's frames and lines."""
        return counted(self.pieces())._replace(lines=self._lines, read_bytes=self._read_bytes)


def bus_log(t_s: FloatArray, can_id: IntArray, payloads: Sequence[bytes]) -> BusLog:
    """Frames from times, identifiers and payloads."""
    lengths = np.array([len(payload) for payload in payloads], np.int64)
    return BusLog(t_s, can_id, lengths, b"".join(payloads))


def parse_candump(text: bytes) -> BusLog:
    """The frames of candump's lines; other lines and an incomplete last one are left out.

    >>> log = parse_candump(b"(10.001000) vcan0 080#0102\\n(10.002000) vcan0 0")
    >>> log.t_s.tolist(), hex(log.can_id[0]), log.payloads
    ([10.001], '0x80', (b'\\x01\\x02',))
    """
    t_s, can_id, payloads = [], [], []
    for seconds, identifier, data in LINE.findall(text):
        t_s.append(float(seconds))
        can_id.append(int(identifier, 16))
        payloads.append(bytes.fromhex(data.decode()))
    return bus_log(np.array(t_s, np.float64), np.array(can_id, np.int64), payloads)
