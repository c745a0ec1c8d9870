"""Values of the state records at power-up."""

from typing import Any, TypeVar, get_args, get_origin

Record = TypeVar("Record", bound=tuple[Any, ...])

ZEROS = {int: 0, float: 0.0, bool: False}


def zeroed(record: type[Record], **others: object) -> Record:
    """A NamedTuple of type `record` with every number 0, every truth value False, and `others` as given.

    A field with a default has its default. Records within the record are zeroed too. A field of another type,
    such as an enum, has no zero and must be among `others`; otherwise KeyError is raised. It is called when a
    module is imported, never in a tick.

    >>> from typing import NamedTuple
    >>> class Level(NamedTuple):
    ...     ticks: int
    ...     height_m: float
    >>> zeroed(Level, ticks=3)
    Level(ticks=3, height_m=0.0)
    """
    given = record._field_defaults | others  # type: ignore[attr-defined]  # of every NamedTuple
    kinds = record.__annotations__.items()
    return record(**{name: zero(kind) for name, kind in kinds if name not in given}, **given)


def zero(kind: Any) -> Any:
    """The zero of a field's type."""
    if get_origin(kind) is tuple:
        return tuple(map(zero, get_args(kind)))
    return zeroed(kind) if hasattr(kind, "_fields") else ZEROS[kind]
