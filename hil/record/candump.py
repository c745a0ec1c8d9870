"""Parses candump's log lines, `(seconds.micros) channel ID#DATA`, in blocks of lines.

A block whose lines all have the same format, as written by the bench and by candump, is parsed as arrays; any
other block is parsed line by line.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import FloatArray, IntArray

LINE = re.compile(rb"\((\d{1,12}\.\d{6,9})\) \S+ ([0-9A-Fa-f]{1,8})#((?:[0-9A-Fa-f]{2}){0,64})\r?\n")
BLOCK_BYTES = 1 << 22
"""Block size: some hundred thousand lines."""
LONGEST_LINE_BYTES = 1 << 10
"""Largest part of an unfinished line that is kept; limits the memory for a file without line ends."""
TENTH_S = 0.1
"""Averaging time of the load over time: the period of the slowest cyclic frames."""
TIME_RESOLUTION_S = 1e-6
"""Resolution of candump's times."""
MOST_BYTES = 8
"""Largest number of data bytes of a classic CAN frame."""
MOST_DIGITS = 15
"""A float represents every number of 15 decimal digits."""
NO_DIGIT = 255
HEX_DIGITS = np.full(256, NO_DIGIT, np.uint8)
HEX_DIGITS[list(b"0123456789ABCDEF")] = range(16)
HEX_DIGITS[list(b"abcdef")] = range(10, 16)


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
    """The frames of a candump log on disk, read in blocks."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines = self._read_bytes = 0

    def pieces(self) -> Iterator[BusLog]:
        """The frames in pieces."""
        self._lines = self._read_bytes = 0
        with self._path.open("rb") as file:
            left = b""
            while block := file.read(BLOCK_BYTES):
                self._read_bytes += len(block)
                self._lines += block.count(b"\n")
                text = left + block
                end = text.rfind(b"\n") + 1
                left = text[end:][-LONGEST_LINE_BYTES:]
                if end:
                    yield parse_candump(text[:end])

    @cached_property
    def counts(self) -> BusCounts:
        """Counts of the file's frames and lines."""
        return counted(self.pieces())._replace(lines=self._lines, read_bytes=self._read_bytes)


def bus_log(t_s: FloatArray, can_id: IntArray, payloads: Sequence[bytes]) -> BusLog:
    """Frames from times, identifiers and payloads."""
    lengths = np.array([len(payload) for payload in payloads], np.int64)
    return BusLog(t_s, can_id, lengths, b"".join(payloads))


def parse_candump(text: bytes) -> BusLog:
    """The frames of candump's lines; an incomplete last line is left out.

    >>> log = parse_candump(b"(10.001000) vcan0 080#0102\\n(10.002000) vcan0 0")
    >>> log.t_s.tolist(), hex(log.can_id[0]), log.payloads
    ([10.001], '0x80', (b'\\x01\\x02',))
    """
    return alike(text) or parse_lines(text)


def parse_lines(text: bytes) -> BusLog:
    """The frames of lines in any of candump's formats; an incomplete last line is left out."""
    t_s, can_id, payloads = [], [], []
    for match in LINE.finditer(text):
        seconds, identifier, data = match.groups()
        t_s.append(float(seconds))
        can_id.append(int(identifier, 16))
        payloads.append(bytes.fromhex(data.decode()))
    return bus_log(np.array(t_s, np.float64), np.array(can_id, np.int64), payloads)


def number(digits: NDArray[np.uint8], ends: IntArray, counts: IntArray, base: int) -> IntArray:
    """Numbers of `counts` digits each that end before `ends`; negative if a character is no digit."""
    value = np.zeros(len(ends), np.int64)
    wrong = np.zeros(len(ends), bool)
    for place in range(int(counts.max(initial=0))):
        digit = digits[ends - 1 - place]
        inside = counts > place
        wrong |= inside & (digit >= base)
        value += np.where(inside, digit.astype(np.int64) * base**place, 0)
    return np.where(wrong, -1, value)


def alike(text: bytes) -> BusLog | None:
    """The frames of whole lines of the same format; None if the formats differ."""
    characters = np.frombuffer(text, np.uint8)
    marks = [np.flatnonzero(characters == ord(mark)) for mark in "\n(.)#"]
    ends, opening, dots, closing, hashes = marks
    if len({len(places) for places in marks}) != 1 or len(ends) == 0:
        return None
    starts = np.concatenate([[0], ends[:-1] + 1])
    spaces = np.flatnonzero(characters == ord(" "))
    if len(spaces) != 2 * len(ends):
        return None
    first, second = spaces[::2], spaces[1::2]
    in_order = (starts == opening) & (opening < dots) & (dots < closing) & (closing + 1 == first)
    in_order &= (first + 1 < second) & (second < hashes) & (hashes < ends)
    fraction = closing - dots - 1
    seconds, identifier, hexadecimal = dots - opening - 1, hashes - second - 1, ends - hashes - 1
    lengths = hexadecimal // 2
    fits = in_order & (fraction == fraction[0]) & (hexadecimal % 2 == 0) & (lengths <= MOST_BYTES)
    fits &= (seconds >= 1) & (seconds + fraction <= MOST_DIGITS) & (identifier >= 1) & (identifier <= 8)
    if not fits.all() or not 6 <= fraction[0] <= 9:
        return None
    digits = HEX_DIGITS[characters]
    whole, part = number(digits, dots, seconds, 10), number(digits, closing, fraction, 10)
    can_id = number(digits, hashes, identifier, 16)
    if min(whole.min(), part.min(), can_id.min()) < 0:
        return None
    scale = 10 ** int(fraction[0])
    is_data = np.zeros(len(characters) + 1, np.int8)
    is_data[hashes + 1] += 1
    is_data[ends] -= 1
    data = digits[np.cumsum(is_data[:-1], dtype=np.int8).astype(bool)]
    if (data == NO_DIGIT).any():
        return None
    content = (data[::2] << 4 | data[1::2]).tobytes()
    # Both are whole numbers below 2^53, so their quotient is the correctly rounded decimal number.
    return BusLog((whole * scale + part) / scale, can_id, lengths, content)
