"""Traces: fixed records of a process's ticks in a memory-mapped file.

The kernel owns the pages as soon as a record is written, so a killed process loses nothing, and other
processes can read the file at the same time. Under user-mode Linux the run folder holds a link until the end
of the run, and the file lies in the guest's memory: writing pages of a mapped file to hostfs during the run
would delay the writer by 20 to 50 ms each second. A file is

    magic (8 bytes) | header bytes (u32) | record bytes (u32) | records (u64) | columns as JSON | records

with the records starting on a page boundary, packed, little-endian. The count is written after its record.
If the disk is full, later records are lost, but the writing process, which may be a controller, continues.
"""

import errno
import json
import mmap
import os
import shutil
import struct
import sys
from collections.abc import Hashable, Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from hil.record import formats
from hil.record.new_file import make_anew
from hil.timing.realtime import is_user_mode_linux
from text_input import RefusalError

MAGIC = b"VHTRACE%d" % formats.TRACE
PREAMBLE = struct.Struct("<8sIIQ")
COUNT = struct.Struct("<Q")
COUNT_OFFSET = 16
WINDOW_BYTES = 8 << 20
"""Increment of the file's size: about ten seconds of a hundred columns at 1 kHz."""
LARGEST_FIRST_WINDOW_BYTES = 256 << 20
"""Largest size in memory from the start: about two minutes of the firmware's records."""

LARGEST_HEADER_BYTES = 1 << 20
"""Ten times the header of the firmware's trace, which has the most columns."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EAGAIN, errno.ENOMEM)
"""A full disk, an exceeded quota; no memory to map the file, or none that may be locked."""

MEMORY = Path("/dev/shm")
"""Folder of the traces during a run under user-mode Linux."""

FieldType = type[Any]
"""float, int, bool, an IntEnum, or a NamedTuple of these to any depth."""
Fields: TypeAlias = Sequence[tuple[str, FieldType]]
"""Pairs of a name and a type; a NamedTuple becomes dotted names, without a prefix if its name is empty."""


class TraceError(RefusalError, ValueError):
    """A file is not a trace, or a record cannot be stored in a trace."""


class Column(NamedTuple):
    """One number of a record: its dotted name and its struct format character."""

    name: str
    code: str


NUMPY_CODES = {"d": "<f8", "q": "<i8", "?": "?"}
TYPES = {"f": float, "i": int, "b": bool}
"""The type of a field for each kind of numpy's types."""


def scalar_code(name: str, kind: FieldType) -> str:
    """The struct format character of a scalar type."""
    if kind is float:
        return "d"
    if kind is bool:
        return "?"
    if kind is int or (isinstance(kind, type) and issubclass(kind, IntEnum)):
        return "q"
    raise TraceError(
        f"trace column {name} is of type {kind!r}; wanted float, int, bool, an IntEnum or a NamedTuple"
    )


def is_record(kind: FieldType) -> bool:
    """Whether `kind` is a NamedTuple class."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")


hints_of = cache(get_type_hints)


def flatten(name: str, kind: FieldType) -> list[Column]:
    """The columns of one field; with an empty `name` its members have no prefix.

    >>> class Point(NamedTuple):
    ...     x_m: float
    ...     hit: bool
    >>> flatten("truth", Point)
    [Column(name='truth.x_m', code='d'), Column(name='truth.hit', code='?')]
    """
    if not is_record(kind):
        return [Column(name, scalar_code(name, kind))]
    hints = hints_of(cast(Hashable, kind))
    prefix = f"{name}." if name else ""
    return [column for member in kind._fields for column in flatten(prefix + member, hints[member])]


def columns_of_fields(fields: Fields) -> list[Column]:
    """The columns of a record with these fields. Raises TraceError if two have one name."""
    columns = [column for name, kind in fields for column in flatten(name, kind)]
    names = [column.name for column in columns]
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise TraceError(f"a trace names columns twice: {', '.join(twice)}")
    return columns


def fields_in(dtype: "np.dtype[np.void]") -> Fields:
    """The fields of records of a packed type."""
    return [(name, TYPES[dtype[name].kind]) for name in dtype.names or ()]


def numbers_of(record: Sequence[Any], into: list[Any]) -> list[Any]:
    """All numbers of a record, added to `into` in the order of `flatten`."""
    for value in record:
        if isinstance(value, tuple):
            numbers_of(value, into)
        else:
            into.append(value)
    return into


class RecordWriter(Protocol):
    """The end of a trace to which a node appends its records."""

    lost: int

    @property
    def dtype(self) -> "np.dtype[np.void]":
        """The packed numpy type of a record."""

    def append(self, *values: Any) -> None:
        """Write one record with one value per field."""

    def append_bytes(self, packed: memoryview) -> None:
        """Write records that are already packed."""

    def close(self) -> None:
        """End the trace."""


class OpenTrace(Protocol):
    """Opens a node's trace."""

    def __call__(self, name: str, fields: Fields, is_ticked: bool = False) -> RecordWriter | None:
        """`is_ticked`: whether it has a record a tick. None if the run does not keep this trace."""


def no_trace(name: str, fields: Fields, is_ticked: bool = False) -> None:
    """Keep no trace."""


class TraceWriter:
    """Appends records of fixed `fields` to `path`.

    With `expected_records` the file has its full size from the start and is in memory, so
    that a loop meets neither growth nor page faults; for a long run this holds only at its beginning. `lost`
    counts the records for which the disk had no room.
    """

    def __init__(
        self,
        path: Path,
        fields: Fields,
        expected_records: int = 0,
        resume: bool = False,
        in_memory: bool = True,
    ) -> None:
        """`resume`: continue after the last record of a trace whose writer was killed, if the trace exists.

        `in_memory`: whether the pages of `expected_records` are allocated and loaded at once.

        Raises TraceError if the disk has no room for `expected_records`.
        """
        self._name = path.name
        self.columns = columns_of_fields(fields)
        self._layout = struct.Struct("<" + "".join(column.code for column in self.columns))
        self.record_bytes = self._layout.size
        self.count = self.lost = 0
        described = json.dumps([[column.name, column.code] for column in self.columns]).encode()
        page = mmap.ALLOCATIONGRANULARITY
        self._header_bytes = -(-(PREAMBLE.size + len(described)) // page) * page
        expected_bytes = expected_records * self.record_bytes
        if resume and path.exists():
            self._resume(path.resolve(), described)
        else:
            home = MEMORY / f"vibrohil-{os.getpid()}-{path.name}" if is_user_mode_linux() else path
            refuse_full_disk(home, expected_bytes)
            self._create(path, home, described)
        self._window: mmap.mmap | None = None
        self._offset = 0
        self._last_offset = -1
        first_bytes = max(1, min(expected_bytes, LARGEST_FIRST_WINDOW_BYTES)) if in_memory else 0
        window = self._open_window(max(WINDOW_BYTES, first_bytes))
        if self.count == 0:
            # Loads each page as writable; not when the file grows, which would load thousands within a loop.
            # The first page of a file alone takes some milliseconds.
            np.frombuffer(window, np.uint8)[: first_bytes : mmap.PAGESIZE] = 0

    def _create(self, path: Path, home: Path, described: bytes) -> None:
        """Create a file with its header at `home`; `path` becomes a link to it."""
        # The file gets its name once its header is complete, so that no reader finds an incomplete header.
        unfinished = make_anew(home.with_name(f"{home.name}.new"))
        self._file = unfinished.open("r+b")
        self._file.truncate(self._header_bytes)
        self._header = mmap.mmap(self._file.fileno(), self._header_bytes)
        self._header[PREAMBLE.size : PREAMBLE.size + len(described)] = described
        PREAMBLE.pack_into(self._header, 0, MAGIC, self._header_bytes, self.record_bytes, 0)
        unfinished.rename(home)
        if home != path:
            path.unlink(missing_ok=True)
            path.symlink_to(home)

    def _resume(self, home: Path, described: bytes) -> None:
        """Open a file that another process has created."""
        self._file = home.open("r+b")
        self._header = mmap.mmap(self._file.fileno(), self._header_bytes)
        _, header_bytes, record_bytes, self.count = PREAMBLE.unpack_from(self._header)
        known = self._header[PREAMBLE.size : PREAMBLE.size + len(described)]
        if (header_bytes, record_bytes, known) != (self._header_bytes, self.record_bytes, described):
            self._header.close()
            self._file.close()
            raise TraceError(f"{home} has other columns than this run records; choose a new run folder")

    def _open_window(self, length: int) -> mmap.mmap:
        """Map the next `length` bytes after the records written so far, with allocated disk space."""
        start = self._header_bytes + self.count * self.record_bytes
        aligned = start // mmap.ALLOCATIONGRANULARITY * mmap.ALLOCATIONGRANULARITY
        length = max(length, start - aligned + self.record_bytes)
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(self._file.fileno(), aligned, length)
        else:
            self._file.truncate(aligned + length)
        if self._window is not None:
            self._window.close()
        self._window = mmap.mmap(self._file.fileno(), length, offset=aligned)
        self._offset = start - aligned
        self._last_offset = length - self.record_bytes
        return self._window

    def append(self, *values: Any) -> None:
        """Write one record with one value per field; if the disk is full, the record is lost and counted."""
        offset = self._offset
        if offset > self._last_offset:
            if not self._has_grown():
                self.lost += 1
                return
            offset = self._offset
        assert self._window is not None
        self._layout.pack_into(self._window, offset, *numbers_of(values, []))
        self._offset = offset + self.record_bytes
        self.count += 1
        COUNT.pack_into(self._header, COUNT_OFFSET, self.count)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The packed numpy type of a record."""
        return np.dtype([(column.name, NUMPY_CODES[column.code]) for column in self.columns])

    def append_all(self, records: NDArray[np.void]) -> None:
        """Write records of `dtype`."""
        self.append_bytes(memoryview(records.view(np.uint8)))  # type: ignore[arg-type]  # no buffer in numpy's stubs

    def append_bytes(self, left: memoryview) -> None:
        """Write records that are already packed."""
        while left:
            room = (self._last_offset - self._offset) // self.record_bytes + 1
            if room <= 0 and not self._has_grown():
                self.lost += len(left) // self.record_bytes
                return
            if room > 0:
                length = min(room * self.record_bytes, len(left))
                assert self._window is not None
                self._window[self._offset : self._offset + length] = left[:length]
                self._offset += length
                self.count += length // self.record_bytes
                left = left[length:]
        COUNT.pack_into(self._header, COUNT_OFFSET, self.count)

    def _has_grown(self) -> bool:
        """Whether there is room for a record; growth is not retried after a failure, since it is slow."""
        if self.lost == 0:
            try:
                self._open_window(WINDOW_BYTES)
            except OSError as error:
                if error.errno not in NO_ROOM:
                    raise
                print(f"{self._name}: {error.strerror}; nothing is recorded from now on", file=sys.stderr)
        return self._offset <= self._last_offset

    def close(self) -> None:
        """Close the file and free its unused space."""
        if self._window is None:
            return
        self._window.close()
        self._window = None
        self._header.close()
        self._file.truncate(self._header_bytes + self.count * self.record_bytes)
        self._file.close()

    def __enter__(self) -> "TraceWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def refuse_full_disk(home: Path, needed_bytes: int) -> None:
    """Raise TraceError if the disk has no room for a file of `needed_bytes`."""
    free_bytes = shutil.disk_usage(home.parent).free
    if needed_bytes > free_bytes:
        memory = (
            "; give the inner kernel more, as in vibrohil kernel --memory 8G" if home.parent == MEMORY else ""
        )
        raise TraceError(
            f"{home} of the whole run takes {needed_bytes / 1e9:.2f} GB, and {free_bytes / 1e9:.2f} GB "
            f"are free: shorten the run or make room{memory}"
        )


def is_elsewhere(path: Path) -> bool:
    """Whether a trace of a run folder is a link to a writer's file in memory.

    Only the memory of user-mode Linux is the run's alone; on a machine any user writes there.
    """
    if not (is_user_mode_linux() and path.is_symlink()):
        return False
    home = path.resolve()
    return home.parent == MEMORY and home.name.startswith("vibrohil-")


def bring_home(run_dir: Path) -> None:
    """Move traces from memory into the run folder, after their writers have ended."""
    for link in run_dir.glob("*.trace"):
        if is_elsewhere(link):
            elsewhere = link.resolve()
            copy = make_anew(link.with_name(f"{link.name}.new"))
            shutil.copyfile(elsewhere, copy)
            copy.replace(link)
            elsewhere.unlink()


class Layout(NamedTuple):
    """The header of a trace: its columns, the offset of its records, and the number of whole records."""

    dtype: np.dtype[np.void]
    header_bytes: int
    records: int


def layout_of(path: Path) -> Layout:
    """The layout of a trace, also while it is being written and after its writer was killed."""
    with path.open("rb") as file:
        preamble = file.read(PREAMBLE.size)
        if len(preamble) < PREAMBLE.size or not preamble.startswith(MAGIC):
            raise TraceError(
                f"{path} is no trace of format {formats.TRACE}: it starts with {preamble[:8]!r}, "
                f"wanted {MAGIC!r}; read it with the version that wrote it"
            )
        _, header_bytes, record_bytes, count = PREAMBLE.unpack(preamble)
        if not PREAMBLE.size < header_bytes <= LARGEST_HEADER_BYTES:
            raise TraceError(f"{path} is damaged: its header has {header_bytes} bytes")
        described = file.read(header_bytes - PREAMBLE.size).rstrip(b"\0")
        held_bytes = max(0, os.fstat(file.fileno()).st_size - header_bytes)
    dtype = np.dtype([(name, NUMPY_CODES[code]) for name, code in json.loads(described)])
    if dtype.itemsize != record_bytes or record_bytes == 0:
        raise TraceError(
            f"{path} is damaged: a record has {record_bytes} bytes, its columns {dtype.itemsize}"
        )
    return Layout(dtype, header_bytes, min(count, held_bytes // record_bytes))


def read(path: Path, start: int = 0, stop: int | None = None) -> NDArray[np.void]:
    """The records from number `start` on, up to `stop`, as a structured array with columns by dotted names.

    Works while the file is being written and after its writer was killed.
    """
    dtype, header_bytes, count = layout_of(path)
    end = count if stop is None else min(stop, count)
    with path.open("rb") as file:
        file.seek(header_bytes + start * dtype.itemsize)
        content = file.read(max(0, end - start) * dtype.itemsize)
    whole = len(content) // dtype.itemsize * dtype.itemsize
    return np.frombuffer(content[:whole], dtype)
