"""Types of arrays by their elements, and arrays of records."""

from functools import cache
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_Record = TypeVar("_Record")


class One(Protocol[_Record]):
    """An array of one record, so that kernels can change the record in place."""

    def __getitem__(self, index: Literal[0]) -> _Record: ...

    def __setitem__(self, index: Literal[0], record: _Record) -> None: ...


@cache
def record_type(kind: type) -> np.dtype[np.void]:
    """The type of records with the fields that `kind` declares as float or int."""
    return np.dtype((np.record, [(name, np.dtype(number)) for name, number in kind.__annotations__.items()]))


def zeros_of(kind: type, count: int) -> Any:
    """`count` such records, shape (count,)."""
    return np.zeros(count, record_type(kind))
