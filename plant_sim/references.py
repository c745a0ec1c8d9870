"""Records that kernels receive by reference: a pointer to a copy in the memory layout of numba.

A kernel that takes nested records by value copies them in every call. A reference costs a pointer, and one
compiled kernel serves all records of a type.
"""

import ctypes
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, typeof_impl, unbox

from plant_sim.kernels import IS_INTERPRETED, entry_point, jit, kind_of

_Record = TypeVar("_Record", bound=tuple[Any, ...])

PARENT = 1
"""Place of the address of Python's array among the words of an array (numba's ArrayModel)."""


class ReferenceType(types.Type):  # type: ignore[misc]  # numba carries no types
    """A pointer to a record (NamedTuple) that does not change while kernels run."""

    def __init__(self, record: Any) -> None:
        self.record = record
        self.instance_class = record.instance_class
        super().__init__(f"Reference({record})")


@register_default(ReferenceType)
class _PointerModel(models.PrimitiveModel):  # type: ignore[misc]  # numba carries no types
    def __init__(self, manager: Any, its_type: ReferenceType) -> None:
        super().__init__(manager, its_type, manager.lookup(its_type.record).get_value_type().as_pointer())


def _field_type(record: Any, index: int) -> Any:
    field = record[index]
    return ReferenceType(field) if isinstance(field, types.BaseNamedTuple) else field


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]  # numba carries no types
    key = ReferenceType

    def generic_resolve(self, reference: ReferenceType, name: str) -> Any:
        fields = reference.record.fields
        return _field_type(reference.record, fields.index(name)) if name in fields else None


@lower_getattr_generic(ReferenceType)
def _read_field(context: Any, builder: Any, reference: ReferenceType, pointer: Any, name: str) -> Any:
    """A field: nested records by reference, all others by value."""
    index = reference.record.fields.index(name)
    field = cgutils.gep_inbounds(builder, pointer, 0, index)
    its_type = _field_type(reference.record, index)
    if isinstance(its_type, ReferenceType):
        return field
    value = builder.load(field)
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return impl_ret_borrowed(context, builder, its_type, value)


class Reference:
    """A record, the fields that kernels read of it, and their copy in the layout of kernels: words of eight
    bytes."""

    __slots__ = ("_words", "address", "fields", "numba_type", "record")

    def __init__(self, record: tuple[Any, ...], fields: tuple[Any, ...], kind: Any) -> None:
        """`fields` for kernels; `kind` determines the compiled type: the record's class, or `kind_of` it."""
        self.record = record
        self.fields = fields  # keeps the arrays alive
        if kind not in _LAYOUTS:
            store = entry_point(_store, fields, 0)
            _LAYOUTS[kind] = ReferenceType(numba.typeof(fields)), ctypes.c_int64 * word_count(fields), store
        self.numba_type, words, store = _LAYOUTS[kind]
        self._words = words()
        self.address = ctypes.addressof(self._words)
        store(fields, self.address)

    @property
    def words(self) -> list[int]:
        """The words of the copy, with zeros for the addresses of Python's arrays, which no kernel reads."""
        words = list(self._words)
        for index in _array_objects(self.fields):
            words[index] = 0
        return words

    def __getattr__(self, name: str) -> Any:
        return getattr(self.record, name)


def _store_record(_: Any, record: Any, address: Any) -> Any:
    """Store a record at an address, in numba's layout."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = context.get_value_type(signature.args[0]).as_pointer()
        builder.store(values[0], builder.inttoptr(values[1], pointer))
        return context.get_dummy_value()

    return types.void(record, address), generate


_store_at = intrinsic(_store_record)


def _store_words(record: tuple[Any, ...], address: int) -> None:
    """Store a record at an address."""
    _store_at(record, address)


_store = jit(_store_words, _nrt=False)
_LAYOUTS: dict[Any, tuple[ReferenceType, Any, Callable[[tuple[Any, ...], int], None]]] = {}
"""Type, words and function to store it, by the kind of record: numba takes a millisecond to find a type."""


def by_reference(record: _Record, layout: Any = None) -> _Record:
    """The record for a kernel, in the fields of `layout` if one is given: a record whose class determines the
    types of all its fields. A record by reference stays as it is.

    Kernels that Python interprets (NUMBA_DISABLE_JIT) take the record itself.
    """
    if IS_INTERPRETED or isinstance(record, Reference):
        return record
    kind, fields = (kind_of(record), record) if layout is None else (type(layout), layout)
    reference: Any = Reference(record, fields, kind)
    its_record: _Record = reference
    return its_record


def word_count(value: Any) -> int:
    """The number of words of a number, an array (numba's ArrayModel) or a record."""
    if isinstance(value, tuple):
        return sum(map(word_count, value))
    if isinstance(value, float) or type(value) is int:
        return 1
    if isinstance(value, np.ndarray):
        return 5 + 2 * value.ndim
    raise TypeError(f"{value!r} in a record for kernels; wanted a float, an int, an array or a record")


def _array_objects(record: tuple[Any, ...], start: int = 0) -> list[int]:
    """The places of Python's arrays (`parent`) among the words of a record, which begin at `start`."""
    places = []
    for value in record:
        if isinstance(value, tuple):
            places += _array_objects(value, start)
        elif isinstance(value, np.ndarray):
            places.append(start + PARENT)
        start += word_count(value)
    return places


@typeof_impl.register(Reference)
def _type_of(reference: Reference, _: Any) -> ReferenceType:
    return reference.numba_type


@unbox(ReferenceType)
def _pointer_of(its_type: ReferenceType, reference: Any, c: Any) -> Any:
    address = c.pyapi.object_getattr_string(reference, "address")
    number = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.inttoptr(number, c.context.get_value_type(its_type)))
