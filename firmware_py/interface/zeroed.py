"""Values of the state records at power-up."""

from typing import Any, TypeVar

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
    zeros = {
        name: zeroed(kind) if hasattr(kind, "_fields") else ZEROS[kind]
        for name, kind in record.__annotations__.items()
        if name not in given
    }
    return record(**zeros, **given)
