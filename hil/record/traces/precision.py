"""The precision of the log's numbers, from which figures, report and log are made.

A tick's record is stored in single precision, 24 bits: sensors resolve 16 bits, and frames at most 24.
Energies stay in double precision, since figures are small differences of large sums. The target speed stays
in double precision too: it is constant, so its rounding error would not average out. Times are rounded to
whole nanoseconds, as in the log's timelines. Located impacts are stored unchanged. Figures recomputed from
the log therefore equal those of the verdict bit for bit.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

TICKED = ("plant", "firmware")
"""The traces stored with this precision."""
TIME = "t_s"
ENERGY = "_j"
EXACT = frozenset({TIME, "outputs.target_omega_rad_s"})
NS_PER_S = 1e9
LATEST_S = 1e9
"""Latest time of a run: thirty years. Whole nanoseconds up to it, and after 1970, have room in 64 bits."""
CACHED_RECORDS = 128
"""Number of records copied at once: some hundred kilobytes of the longest records."""


def kept_type(kind: np.dtype[Any]) -> np.dtype[Any]:
    """The stored type of a record.

    >>> kept_type(np.dtype([("t_s", "f8"), ("tick", "i8"), ("x_m", "f8"), ("stored_j", "f8")])).descr
    [('t_s', '<f8'), ('tick', '<i8'), ('x_m', '<f4'), ('stored_j', '<f8')]
    """
    columns = [(name, kind[name]) for name in kind.names or ()]
    return np.dtype([(name, np.float32 if is_single(name, own) else own) for name, own in columns])


def is_single(name: str, kind: np.dtype[Any]) -> bool:
    """Whether a column is stored in single precision."""
    return kind == np.float64 and name not in EXACT and not name.endswith(ENERGY)


def kept_column(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """A column of a trace as stored; values too large for single precision become infinite."""
    if name == TIME:
        return np.asarray(np.round(values * NS_PER_S) / NS_PER_S)
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, np.float32 if is_single(name, values.dtype) else None)


def whole_ns(t_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Times in whole nanoseconds; raises ValueError for one beyond `LATEST_S`, or that is no number."""
    if not np.all(np.abs(t_s) <= LATEST_S):
        beyond_s = t_s[~(np.abs(t_s) <= LATEST_S)][0]
        raise ValueError(f"a record has the time {beyond_s:g} s, and no run lasts {LATEST_S:g} s")
    return np.round(t_s * NS_PER_S).astype(np.int64)


def columns_of(records: NDArray[np.void], exact: bool = False) -> dict[str, NDArray[Any]]:
    """Separate the columns of a trace, as stored, or unchanged if `exact`.

    A record is longer than a cache line, so a group of records that fits into the cache is separated at once.
    """
    kind = records.dtype if exact else kept_type(records.dtype)
    columns = {name: np.empty(len(records), kind[name]) for name in kind.names or ()}
    with np.errstate(over="ignore"):
        for start in range(0, len(records), CACHED_RECORDS):
            rows = slice(start, start + CACHED_RECORDS)
            some = records[rows]
            for name, values in columns.items():
                values[rows] = some[name]
    if not exact and TIME in columns:
        columns[TIME] = kept_column(TIME, columns[TIME])
    return columns
