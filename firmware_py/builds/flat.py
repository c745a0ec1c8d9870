"""Records in flat memory: a NamedTuple of the subset as a numpy structured type, which equals a C struct.

Integers take eight bytes, floats eight or, in single precision, four; enums are integers, bools take one
byte; members are aligned as a C compiler aligns them.
"""

import functools
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Memory = NDArray[np.void]
Precision = Literal["double", "single"]


@functools.cache
def members(kind: Any) -> tuple[tuple[str, Any], ...]:
    """Names and types of a NamedTuple's members, in order."""
    hints = get_type_hints(kind)
    return tuple((name, hints[name]) for name in kind._fields)


@functools.cache
def layout(kind: Any, precision: Precision = "double") -> Any:
    """The numpy type of a record or one of its members; raise TypeError for a type outside the subset."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        if len(set(items)) != 1:
            raise TypeError(f"{kind}: wanted a tuple of one type, or a NamedTuple")
        return np.dtype((layout(items[0], precision), len(items)))
    if kind is float:
        return np.dtype(np.float64 if precision == "double" else np.float32)
    if kind is bool:
        return np.dtype(np.bool_)
    if kind is int or (isinstance(kind, type) and issubclass(kind, IntEnum)):
        return np.dtype(np.int64)
    if not hasattr(kind, "_fields"):
        raise TypeError(f"{kind}: wanted float, int, bool, an IntEnum, or a NamedTuple or tuple of these")
    return np.dtype([(name, layout(member, precision)) for name, member in members(kind)], align=True)


def to_flat(record: tuple[Any, ...]) -> Memory:
    """A copy of the record in flat memory, an array of one element."""
    memory = np.zeros(1, layout(type(record)))
    memory[0] = _plain(record)
    return cast(Memory, memory)


def to_precision(memory: Memory, kind: Any, precision: Precision) -> Memory:
    """Records of type `kind` with floats of this precision, each rounded once; infinite beyond its range."""
    wanted = layout(kind, precision)
    if memory.dtype == wanted:
        return memory
    other: Memory = np.zeros(memory.shape, wanted)  # astype would leave the padding undefined
    with np.errstate(over="ignore"):
        other[:] = memory
    return other


def copier(source: Memory, destination: Memory) -> Callable[[], None]:
    """A function that copies `source` to `destination`, a record of the same type in any precision.

    It does nothing if they are the same memory.
    """
    if source is destination:
        return lambda: None
    if source.dtype == destination.dtype:
        return functools.partial(destination.__setitem__, slice(None), source)
    offsets: dict[str, list[tuple[int, int]]] = {}
    views: dict[str, tuple[Any, Any]] = {}
    for (kind, start), (other, target) in zip(_leaves(source.dtype), _leaves(destination.dtype), strict=True):
        offsets.setdefault(kind.kind, []).append((start // kind.itemsize, target // other.itemsize))
        views[kind.kind] = source.view(kind), destination.view(other)
    moves = [(*views[kind], *np.array(found).T) for kind, found in offsets.items()]

    def copy() -> None:
        for taken, given, sources, targets in moves:
            given[targets] = taken[sources]

    return copy


def _leaves(kind: Any, start: int = 0) -> Iterator[tuple[Any, int]]:
    """The numeric types within a type, each with its offset in bytes."""
    if kind.subdtype is not None:
        item, (count,) = kind.subdtype
        for index in range(count):
            yield from _leaves(item, start + index * item.itemsize)
    elif kind.names is not None:
        for member, offset in kind.fields.values():
            yield from _leaves(member, start + offset)
    else:
        yield kind, start


def _plain(value: Any) -> Any:
    """The record in the form that numpy accepts: records as plain tuples, tuples of one type as lists."""
    if not isinstance(value, tuple):
        return value
    return tuple(map(_plain, value)) if hasattr(value, "_fields") else list(map(_plain, value))


def from_flat(kind: Any, value: Any) -> Any:
    """The record of type `kind` from `memory[0].item()`, or from a part of it."""
    return _loader(kind)(value)


@functools.cache
def _loader(kind: Any) -> Callable[[Any], Any]:
    """A function that converts the value from `item` into a record of this type or one of its members."""
    if get_origin(kind) is tuple:
        items = [_loader(item) for item in get_args(kind)]
        # `item` does not convert an array within a record.
        return lambda value: tuple(
            load(one) for load, one in zip(items, np.asarray(value).tolist(), strict=True)
        )
    if not hasattr(kind, "_fields"):
        return cast(Callable[[Any], Any], kind)
    if all(member in (float, int, bool) for _, member in members(kind)):
        return cast(Callable[[Any], Any], kind._make)  # `item` converts these itself
    loads = [_loader(member) for _, member in members(kind)]
    return lambda value: kind._make([load(one) for load, one in zip(loads, value, strict=True)])
