"""The parts of a scene as kernels read them: one record for each slot, whatever part it holds.

The slots are the fields of `Parts`, the parts of a slot those of the field's declared type. A slot's record
has a `kind`, the part's place among them, by which kernels choose its laws (`kernels.by_part`), and the
fields of all its parts; those that the present part does not have are zero or empty.
"""

from collections import namedtuple
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np

from plant_sim.kernels import register_kinds
from plant_sim.parts.parts import Parts
from plant_sim.parts.walking import COLUMNS
from plant_sim.references import Reference, by_reference

_EMPTY: dict[str, Any] = {"rows": np.zeros((1, COLUMNS))}
"""The arrays of an absent part, by the name of their field."""


_SLOTS = get_type_hints(Parts)


def _any(name: str, fields: dict[str, Any]) -> Any:
    """The class of a record with these fields, in this module, where a kernel from the cache looks for it."""
    record = namedtuple(f"Any{name.title()}", fields, module=__name__)  # type: ignore[misc]  # found at run time
    record.__annotations__ = fields
    globals()[record.__name__] = record
    return record


@cache
def _slot_record(slot: str) -> tuple[Any, tuple[type, ...], dict[str, Any]]:
    """The record of a slot, its parts by kind, and the types of its fields without `kind`."""
    members = get_args(_SLOTS[slot]) or (_SLOTS[slot],)
    fields: dict[str, Any] = {}
    for member in members:
        for name, its_type in get_type_hints(member).items():
            if fields.setdefault(name, its_type) != its_type:
                raise TypeError(
                    f"{slot}: {name} is {fields[name]} in one part and {its_type} in another; the fields "
                    "of a slot's parts share one type a name, rename one of them"
                )
    record = _any(slot, {"kind": int, **fields})
    register_kinds(record, members)
    return record, members, fields


@cache
def _columns(slot: str, kind: Any) -> tuple[Any, int, list[tuple[str, Any, Any]]]:
    """The record of a slot, a part's place among its kinds, and each field's name, type and value if the part
    does not have it (None if it does)."""
    record, members, fields = _slot_record(slot)
    own = get_type_hints(kind)
    absent = {
        name: its_type(0) if its_type in (float, int) else _EMPTY[name]
        for name, its_type in fields.items()
        if name not in own
    }
    columns = [(name, its_type, absent.get(name)) for name, its_type in fields.items()]
    return record, members.index(kind), columns


def with_kind(slot: str, part: Any) -> Any:
    """The part as the record of its slot."""
    kind: Any = type(part)
    record, place, columns = _columns(slot, kind)
    values = []
    for name, its_type, absent in columns:
        if absent is not None:
            values.append(absent)
        elif its_type in (float, int):
            values.append(its_type(getattr(part, name)))
        else:
            values.append(np.require(getattr(part, name), requirements=["C", "W"]))
    return record(place, *values)


_AnyParts = _any("parts", dict.fromkeys(Parts._fields, object))
for _slot in Parts._fields:
    _slot_record(_slot)


def kernel_parts(parts: Parts) -> Parts:
    """The parts for kernels. Interpreted kernels (NUMBA_DISABLE_JIT) take them as they are."""
    if isinstance(parts, Reference):
        return parts
    return by_reference(parts, any_parts(parts))


def any_parts(parts: Parts) -> Any:
    """The parts as the record of all slots."""
    return parts.fields if isinstance(parts, Reference) else _AnyParts(*map(with_kind, Parts._fields, parts))
