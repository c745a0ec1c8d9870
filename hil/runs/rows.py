"""The records and frames of lockstep since the last segment, in memory: the traces of its nodes."""

import struct
from collections.abc import Iterable, Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import Frame
from hil.bus.frame_rows import word_frame
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.trace import NUMPY_CODES, Fields, columns_of_fields, numbers_of
from hil.runs.job import Kept
from hil.timing.loop import UNTIMED, LoopTiming

ALWAYS_KEPT = ("tick", "t_s")
"""Columns that every kept trace has, where its records have them."""
FRAME_COLUMNS = 4
"""Columns of a frame's row: its time in µs, identifier, length and word."""


class Rows:
    """The records of one trace; nodes append to it as to a `TraceWriter`, and compiled code in place."""

    def __init__(self, fields: Fields, kept: Sequence[str] | None) -> None:
        """`kept`: the columns that are kept; None for all."""
        columns = columns_of_fields(fields)
        is_kept = [kept is None or column.name in (*ALWAYS_KEPT, *kept) for column in columns]
        self._kept = None if all(is_kept) else is_kept
        own = list(compress(columns, is_kept))
        self.dtype = np.dtype([(column.name, NUMPY_CODES[column.code]) for column in own])
        self._layout = struct.Struct("<" + "".join(column.code for column in own))
        self.lost = self.count = 0
        self._reserve(1)

    def _reserve(self, records: int) -> None:
        """Have memory for `records` more than there are."""
        before = self.taken() if self.count else np.zeros(0, self.dtype)
        self._array = np.zeros(2 * (self.count + records), self.dtype)
        self._bytes = memoryview(self._array.view(np.uint8))  # type: ignore[arg-type]  # no buffer in numpy's stubs
        self._bytes[: before.nbytes] = memoryview(before.view(np.uint8))  # type: ignore[arg-type]

    def append(self, *values: Any) -> None:
        """Write one record with one value per field."""
        numbers = numbers_of(values, [])
        if self._kept is not None:
            numbers = list(compress(numbers, self._kept))
        self.append_bytes(memoryview(self._layout.pack(*numbers)))

    def append_bytes(self, packed: memoryview) -> None:
        """Write packed records."""
        begin = self.count * self.dtype.itemsize
        if begin + len(packed) > len(self._bytes):
            self._reserve(len(packed) // self.dtype.itemsize)
        self._bytes[begin : begin + len(packed)] = packed
        self.count += len(packed) // self.dtype.itemsize

    def append_all(self, records: NDArray[np.void]) -> None:
        """Write records with the same columns."""
        room = self.room(len(records))
        for name in self.dtype.names or ():
            room[name] = records[name]
        self.count += len(records)

    def room(self, records: int) -> NDArray[np.void]:
        """The memory of the next `records`, which count once `count` says so."""
        if self.count + records > len(self._array):
            self._reserve(records)
        return self._array[self.count : self.count + records]

    def taken(self) -> NDArray[np.void]:
        """The records since the last `clear`."""
        return self._array[: self.count]

    def close(self) -> None:
        """Do nothing: there is no file."""


class FrameRows:
    """The frames on the bus: rows of time in µs, identifier, length and word."""

    def __init__(self, is_kept: bool) -> None:
        self._is_kept, self.count = is_kept, 0
        self._array = np.zeros((0, FRAME_COLUMNS), np.int64)
        self._appended: list[tuple[int, ...]] = []

    def append(self, t_us: int, frames: Iterable[Frame]) -> None:
        """Add frames that were on the bus at `t_us`."""
        if self._is_kept:
            self._appended += [(t_us, *word_frame(frame)) for frame in frames]

    def _take_appended(self) -> None:
        rows, self._appended = self._appended, []
        if rows:
            self.room(len(rows))[: len(rows)] = rows
            self.count += len(rows)

    def room(self, frames: int) -> NDArray[np.int64]:
        """The memory of at least `frames` more; empty if frames are not kept."""
        self._take_appended()
        if self._is_kept and self.count + frames > len(self._array):
            more = np.zeros((2 * (self.count + frames), FRAME_COLUMNS), np.int64)
            more[: self.count] = self._array[: self.count]
            self._array = more
        return self._array[self.count :]

    def taken(self) -> NDArray[np.int64]:
        """The frames since the last `clear`."""
        self._take_appended()
        return self._array[: self.count]


class Collected(dict[str, Rows]):
    """The rows of all traces by name; called by the nodes to open theirs."""

    def __init__(self, kept: Kept | None) -> None:
        super().__init__()
        self._kept = kept

    def __call__(self, name: str, fields: Fields, is_ticked: bool = False) -> Rows | None:
        """Open a trace; None if it is not kept."""
        if self._kept is not None and name not in self._kept:
            return None
        self[name] = Rows(fields, None if self._kept is None else self._kept[name])
        return self[name]


def is_whole(columns: "np.dtype[np.void]") -> bool:
    """Whether records of the plant begin with all columns of `PlantRecord`, and all have eight bytes."""
    names = columns.names or ()
    return names[: len(PlantRecord._fields)] == PlantRecord._fields and columns.itemsize == 8 * len(names)


def leave_untimed(records: NDArray[np.void]) -> None:
    """Ticks in compiled code are not timed."""
    for name in set(LoopTiming._fields) & set(records.dtype.names or ()):
        records[name] = getattr(UNTIMED, name)
