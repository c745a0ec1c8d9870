"""A stored trace for figures, report and log: some rows or one column are in memory at a time.

A record has hundreds of columns, and figures use some tens of them. The first access to one of these copies
all of them in one pass, column by column; for a long run into an unnamed file beside the trace. A column is
then read as a whole from the copy, so the judgement of a run needs memory for a few columns only.
"""

import os
import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hil.record.traces import trace
from hil.record.traces.precision import columns_of, kept_column, kept_type

MOST_IN_MEMORY_BYTES = 32 << 20
"""Largest size of the copied columns in memory; a larger copy is written to disk."""
PIECE_RECORDS = 16384
"""About thirty megabytes of the firmware's records; each piece of a log has an overhead of some kilobytes."""
OF_FIGURES = frozenset(
    {"state.estimator.x_m", "state.estimator.v_m_s", "state.estimator.nis", "state.gait.phase"}
)
"""Columns of the firmware's internal state that figures use."""
SELDOM_READ = ("state.", "inputs.", "counters.")


class Records(Protocol):
    """Records of a trace, in memory or on disk: columns by name, rows by slices, masks and numbers."""

    @property
    def dtype(self) -> Any:
        """The columns as a numpy data type."""

    def __len__(self) -> int:
        """Number of records."""

    def __getitem__(self, key: Any, /) -> Any:
        """A column by its name, or a selection of rows."""


class ByColumn(ABC):
    """Records of which one column is read at a time; rows are selected by their numbers."""

    dtype: np.dtype[np.void]
    """The columns' names and types."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of records."""

    @abstractmethod
    def _column(self, name: str) -> NDArray[Any]:
        """One column."""

    def __getitem__(self, key: Any) -> Any:
        return self._column(key) if isinstance(key, str) else Selected(self, np.arange(len(self))[key])


class Columns(ByColumn):
    """Records in memory as separate columns, so that a selection of columns needs no second copy."""

    def __init__(self, columns: Mapping[str, NDArray[Any]], rows: int) -> None:
        self.dtype = np.dtype([(name, values.dtype) for name, values in columns.items()])
        self._columns = columns
        self._rows = rows

    def __len__(self) -> int:
        return self._rows

    def _column(self, name: str) -> NDArray[Any]:
        return self._columns[name]


class PackedRecords(ByColumn):
    """Packed records in memory, of which a column is separated at its first use.

    `exact`: as of `StoredTrace`.
    """

    def __init__(self, records: NDArray[np.void], exact: bool = False) -> None:
        self.dtype = records.dtype if exact else kept_type(records.dtype)
        self._records, self._exact = records, exact
        self._columns: dict[str, NDArray[Any]] = {}

    def __len__(self) -> int:
        return len(self._records)

    def _column(self, name: str) -> NDArray[Any]:
        if name not in self._columns:
            values = self._records[name]
            self._columns[name] = np.ascontiguousarray(values) if self._exact else kept_column(name, values)
        return self._columns[name]


class Selected(ByColumn):
    """A selection of rows of records, by their numbers."""

    def __init__(self, records: ByColumn, rows: NDArray[np.int64]) -> None:
        self.dtype = records.dtype
        self._records = records
        self._rows = rows

    def __len__(self) -> int:
        return len(self._rows)

    def _column(self, name: str) -> NDArray[Any]:
        values: NDArray[Any] = self._records[name]
        return values[self._rows]


def is_read_often(name: str) -> bool:
    """Whether figures use a column."""
    return not name.startswith(SELDOM_READ) or name in OF_FIGURES


class StoredColumns(ByColumn):
    """Records in a file; columns are copied to a temporary store at first use and read from there."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder`: folder of the copies; by default the folder for temporary files."""
        self._places: dict[str, list[tuple[int, int]]] = {}
        self._store = tempfile.SpooledTemporaryFile(  # noqa: SIM115 - closed with the records
            MOST_IN_MEMORY_BYTES, dir=None if folder is None else str(folder)
        )
        weakref.finalize(self, self._store.close)

    @abstractmethod
    def _pieces(self, names: Sequence[str]) -> Iterator[list[NDArray[Any]]]:
        """Yield the columns `names` of all records in pieces."""

    def _column(self, name: str) -> NDArray[Any]:
        """One column, copied to the store at its first use."""
        kind = self.dtype[name]
        if name not in self._places:
            names = [other for other in self.dtype.names or () if is_read_often(other)]
            self._copy(names if is_read_often(name) else [name])
        parts = []
        for place, length in self._places[name]:
            self._store.seek(place)
            parts.append(self._store.read(length))
        return np.frombuffer(b"".join(parts), kind)

    def _copy(self, names: Sequence[str]) -> None:
        """Copy columns into the store."""
        self._places |= {name: [] for name in names}
        self._store.seek(0, os.SEEK_END)
        for piece in self._pieces(names):
            for name, values in zip(names, piece, strict=True):
                place = self._store.tell()
                self._places[name].append((place, self._store.write(values.tobytes())))


class StoredTrace(StoredColumns):
    """The records that a trace has when it is opened.

    `exact`: values as in the trace, not in the log's precision (`hil.record.traces.precision`).
    """

    def __init__(self, path: Path, exact: bool = False) -> None:
        super().__init__(path.parent)
        self._path = path
        self._exact = exact
        own_type, _, self._rows = trace.layout_of(path)
        self.dtype = own_type if exact else kept_type(own_type)

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, slice):
            return super().__getitem__(key)
        start, stop, step = key.indices(len(self))
        records = trace.read(self._path, start, max(start, stop))[::step]
        return Columns(columns_of(records, self._exact), len(records))

    def _pieces(self, names: Sequence[str]) -> Iterator[list[NDArray[Any]]]:
        for start in range(0, len(self), PIECE_RECORDS):
            piece = trace.read(self._path, start, min(start + PIECE_RECORDS, len(self)))
            yield [piece[name] if self._exact else kept_column(name, piece[name]) for name in names]
