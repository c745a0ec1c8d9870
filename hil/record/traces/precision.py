"""The precision of the log: figures, report and log are all made from these numbers.

A tick's record is kept in single precision, 24 bits: sensors resolve 16 bits, and the bus carries no more
than 24. Energies stay in double precision, since figures are made of small differences of large sums, and so
does the target of the speed, which holds still so that its rounding would not average out. Times are whole
nanoseconds, as the log's timelines have them. Located impacts are kept as they are. So figures that are
recomputed from the log are those of the verdict, bit for bit.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

TICKED = ("plant", "firmware")
"""The traces that are kept so."""
TIME = "t_s"
ENERGY = "_j"
EXACT = frozenset({TIME, "outputs.target_omega_rad_s"})
NS_PER_S = 1e9
CACHED_RECORDS = 128
"""Some hundred kilobytes of the longest."""


def kept_type(kind: np.dtype[Any]) -> np.dtype[Any]:
    """A record as it is kept.

    >>> kept_type(np.dtype([("t_s", "f8"), ("tick", "i8"), ("x_m", "f8"), ("stored_j", "f8")])).descr
    [('t_s', '<f8'), ('tick', '<i8'), ('x_m', '<f4'), ('stored_j', '<f8')]
    """
    columns = [(name, kind[name]) for name in kind.names or ()]
    return np.dtype([(name, np.float32 if is_single(name, own) else own) for name, own in columns])


def is_single(name: str, kind: np.dtype[Any]) -> bool:
    """Whether a column is kept in single precision."""
    return kind == np.float64 and name not in EXACT and not name.endswith(ENERGY)


def kept_column(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """A column of a trace as it is kept; what is too large for single precision is infinite."""
    if name == TIME:
        return np.asarray(np.round(values * NS_PER_S) / NS_PER_S)
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, np.float32 if is_single(name, values.dtype) else None)


def columns_of(records: NDArray[np.void], exact: bool = False) -> dict[str, NDArray[Any]]:
    """The columns of a trace, each by itself, as they are kept, or else exactly as they are.

    A record is longer than what a processor fetches at once, so some records are taken apart while they are
    in its cache.
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
