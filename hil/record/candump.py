"""Parses candump's log lines, `(seconds.micros) channel ID#DATA`, in blocks of lines."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hil.record.bus_load import BusLoad, load_of, sum_loads
from plant_sim.arrays import FloatArray, IntArray

LINE = re.compile(rb"\((\d{1,12}\.\d{6,9})\) \S+ ([0-9A-Fa-f]{1,8})#((?:[0-9A-Fa-f]{2}){0,64})\r?\n")
BLOCK_BYTES = 1 << 23
"""Block size: some two hundred thousand lines, of a minute."""
LONGEST_LINE_BYTES = 1 << 10
"""Largest part of an unfinished line that is kept; limits the memory for a file without line ends."""
MOST_BYTES = 8
"""Largest number of data bytes of a classic CAN frame."""


class Bus(ABC):
    """The frames of a run, in memory or on disk."""

    @abstractmethod
    def pieces(self) -> Iterator["BusLog"]:
        """The frames in pieces."""

    @cached_property
    def load(self) -> BusLoad:
        """The load of the bus in each tenth of a second."""
        return sum_loads(load_of(piece.t_s, piece.length) for piece in self.pieces())

    def whole(self) -> "BusLog":
        """All frames in memory."""
        return join_logs(self.pieces())


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


NO_BUS = BusLog(np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), b"")


def join_logs(pieces: Iterable[BusLog]) -> BusLog:
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
        self._kept: BusLog | None = None
        self.frames = self.lines = self.read_bytes = 0
        """Numbers of frames, lines and bytes that were read last."""

    def pieces(self) -> Iterator[BusLog]:
        """The frames in pieces."""
        if self._kept is not None:
            yield self._kept
            return
        self.frames = self.lines = self.read_bytes = 0
        only: BusLog | None = None
        with self._path.open("rb") as file:
            left = b""
            while block := file.read(BLOCK_BYTES):
                self.read_bytes += len(block)
                self.lines += block.count(b"\n")
                text = left + block
                end = text.rfind(b"\n") + 1
                left = text[end:][-LONGEST_LINE_BYTES:]
                bus = parse_candump(text[:end])
                self.frames += len(bus.t_s)
                only = bus if self.read_bytes == len(block) else None
                yield bus
        self._kept = only


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
    found: list[tuple[bytes, bytes, bytes]] = LINE.findall(text)
    return BusLog(
        t_s=np.array([float(seconds) for seconds, _, _ in found], np.float64),
        can_id=np.array([int(identifier, 16) for _, identifier, _ in found], np.int64),
        length=np.array([len(data) // 2 for _, _, data in found], np.int64),
        content=bytes.fromhex(b"".join(data for _, _, data in found).decode()),
    )
