"""Records as flat memory: a NamedTuple of the subset as a numpy structured type, which is also a C struct.

Floats and integers take eight bytes, enums are integers, bools take one byte; members are aligned as a C
compiler aligns them.
"""

from enum import IntEnum
from functools import cache
from typing import Any, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Memory = NDArray[np.void]


@cache
def members(kind: Any) -> tuple[tuple[str, Any], ...]:
    """Names and types of a NamedTuple's members, in order."""
    hints = get_type_hints(kind)
    return tuple((name, hints[name]) for name in kind._fields)


def layout(kind: Any) -> Any:
    """The numpy type of a record or one of its members; raise TypeError for what the subset has not."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        if len(set(items)) != 1:
            raise TypeError(f"{kind}: wanted a tuple of one type, or a NamedTuple")
        return np.dtype((layout(items[0]), len(items)))
    if kind is float:
        return np.dtype(np.float64)
    if kind is bool:
        return np.dtype(np.bool_)
    if kind is int or (isinstance(kind, type) and issubclass(kind, IntEnum)):
        return np.dtype(np.int64)
    if not hasattr(kind, "_fields"):
        raise TypeError(f"{kind}: wanted float, int, bool, an IntEnum, or a NamedTuple or tuple of these")
    return np.dtype([(name, layout(member)) for name, member in members(kind)], align=True)


def stored(record: tuple[Any, ...]) -> Memory:
    """A record in memory of its own, an array of one item."""
    memory = np.zeros(1, layout(type(record)))
    memory[0] = _plain(record)
    return cast(Memory, memory)


def _plain(value: Any) -> Any:
    """The record as numpy takes it: records as plain tuples, tuples of one type as lists."""
    if not isinstance(value, tuple):
        return value
    return tuple(map(_plain, value)) if hasattr(value, "_fields") else list(map(_plain, value))


def loaded(kind: Any, value: Any) -> Any:
    """The record of type `kind` out of `memory[0].item()`, or out of a part of it."""
    if get_origin(kind) is tuple:
        return tuple(loaded(item, one) for item, one in zip(get_args(kind), value, strict=True))
    if not hasattr(kind, "_fields"):
        return kind(value)
    return kind(*(loaded(member, one) for (_, member), one in zip(members(kind), value, strict=True)))
