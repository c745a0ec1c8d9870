"""Registration of the firmware's functions with numba, so that compiled code can call them.

`register()` does not change the functions, so both builds can run in one process. Operations that the subset
cannot express are defined here as machine instructions: the bits of a float32, an enum from a number, and
records in memory. `_replace` of a record is defined in `compilation.record_replace`.
"""

import functools
import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from enum import IntEnum
from types import FunctionType, ModuleType
from typing import Any, get_args, get_origin

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload, register_jitable

import compilation.record_replace  # noqa: F401 - defines `_replace` of records in compiled code
import firmware_py.core
import firmware_py.node
from compilation.linking import LINKED
from firmware_py.builds.flat import layout, members
from firmware_py.core.estimation import kalman
from firmware_py.interface import arrivals, enums, float32, framing
from firmware_py.interface.enums import AxisState, OperatorRequest
from firmware_py.interface.generated import packing, received, unpacking
from firmware_py.node import elements
from firmware_py.node.tick import NodeState

_tuple: Any = types.BaseTuple.from_types


@functools.cache
def register() -> None:
    """Register the firmware's functions for calls from compiled code.

    They are inlined: records of hundreds of members are then not copied at each call, which would take two
    thirds of a tick.
    """
    instead = replacements()
    options: Any = LINKED | {"forceinline": True}
    for module in subset():
        for function in vars(module).values():
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                if function in instead:
                    replaced = overload(function, strict=False, jit_options=options)
                    replaced(functools.partial(_instead, instead[function]))
                else:
                    register_jitable(**options)(function)
    for function, instruction in INSTRUCTIONS.items():
        overload(function, strict=False)(functools.partial(_calling, instruction))


def subset() -> Iterator[ModuleType]:
    """The modules of the subset."""
    yield from (framing, arrivals, packing, unpacking, received)
    for package in (firmware_py.core, firmware_py.node):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            yield importlib.import_module(found.name)


def replacements() -> dict[Any, Any]:
    """The functions that compiled code replaces: filterpy's algebra, by the same algebra written out; and the
    reading of a measurement, by its offset in memory.
    """
    state = layout(NodeState)
    offsets = np.array([offset_of(state, one.path) for one in elements.ALL])
    numbers: dict[Any, int] = {float: 0, bool: 2}
    kinds = np.array([numbers.get(one.kind, 1) for one in elements.ALL])
    bits_of: Any = float32_bits

    def word_at(memory: Any, index: int) -> int:
        at, kind = offsets[index], kinds[index]
        if kind == 0:
            bits: int = bits_of(load_float(memory, at))
            return bits
        number: int = load_integer(memory, at)
        return number & (0xFFFFFFFF if kind == 1 else 0xFF)

    return {
        kalman.predict: kalman.predict_written_out,
        kalman.update: kalman.update_written_out,
        elements.word_at: word_at,
    }


def offset_of(record: Any, path: Sequence[int]) -> int:
    """The offset of a number in a record's memory, in bytes."""
    offset = 0
    for index in path:
        if record.subdtype is not None:
            record = record.subdtype[0]
            offset += index * record.itemsize
        else:
            record, start = list(record.fields.values())[index][:2]
            offset += start
    return offset


def _number_at(kind: Any) -> Any:
    @intrinsic
    def load(_: Any, address: types.Type, offset: types.Type) -> Any:
        """The number of eight bytes at an address plus an offset."""

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            begin = builder.bitcast(arguments[0], ir.IntType(8).as_pointer())
            pointer = builder.gep(begin, [arguments[1]])
            return builder.load(builder.bitcast(pointer, context.get_value_type(kind).as_pointer()), align=1)

        return kind(address, offset), generate

    return load


load_float, load_integer = _number_at(types.float64), _number_at(types.int64)


def _instead(function: FunctionType, *_: Any) -> FunctionType:
    return function


def _calling(instruction: Any, _: Any) -> Any:
    return lambda value: instruction(value)  # noqa: PLW0108 - numba compiles a function, not an intrinsic


def numba_type(kind: Any) -> Any:
    """The type of a record or one of its members in compiled code."""
    if get_origin(kind) is tuple:
        return _tuple([numba_type(item) for item in get_args(kind)])
    if kind is float:
        return types.float64
    if kind is bool:
        return types.boolean
    if kind is int:
        return types.int64
    if isinstance(kind, type) and issubclass(kind, IntEnum):
        return types.IntEnumMember(kind, types.int64)
    return _tuple([numba_type(member) for _, member in members(kind)], kind)


def loader(kind: type[Any]) -> Any:
    """`load(address)` for compiled code: reads a record of this type, laid out as `flat.layout`."""
    record = numba_type(kind)

    @intrinsic
    def load(_: Any, address: types.Type) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            model = context.data_model_manager[record]
            return model.load_from_data_pointer(builder, pointer_to(builder, model, arguments[0]))

        return record(address), generate

    return load


@intrinsic
def store(_: Any, record: types.Type, address: types.Type) -> Any:
    """Store a record in memory laid out as `flat.layout`; for compiled code."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        model = context.data_model_manager[record]
        builder.store(model.as_data(builder, arguments[0]), pointer_to(builder, model, arguments[1]))
        return context.get_dummy_value()

    return types.none(record, address), generate


def member_at(record: Any, name: str, kind: Any = types.voidptr) -> Any:
    """`at(address)` for compiled code: the address, of type `kind`, of a member of a record in memory."""
    whole, index = numba_type(record), members(record).index((name, dict(members(record))[name]))

    @intrinsic
    def at(_: Any, address: types.Type) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = pointer_to(builder, context.data_model_manager[whole], arguments[0])
            inner = builder.gep(pointer, [ir.IntType(32)(0), ir.IntType(32)(index)])
            return builder.bitcast(inner, context.get_value_type(kind))

        return kind(address), generate

    return at


def pointer_to(builder: Any, model: Any, address: Any) -> Any:
    """The address, an integer or any pointer, as a pointer to a record."""
    kind = model.get_data_type().as_pointer()
    is_pointer = isinstance(address.type, ir.PointerType)
    return builder.bitcast(address, kind) if is_pointer else builder.inttoptr(address, kind)


@intrinsic
def float32_bits(_: Any, value: types.Type) -> Any:
    """The bits of the nearest float32."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        narrow = builder.fptrunc(arguments[0], ir.FloatType())
        return builder.zext(builder.bitcast(narrow, ir.IntType(32)), ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic
def float32_of(_: Any, bits: types.Type) -> Any:
    """The float32 of 32 bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = builder.trunc(arguments[0], ir.IntType(32))
        return builder.fpext(builder.bitcast(word, ir.FloatType()), ir.DoubleType())

    return types.float64(types.int64), generate


def _member_of(enum: type[IntEnum]) -> Any:
    member = types.IntEnumMember(enum, types.int64)

    @intrinsic
    def convert(_: Any, value: types.Type) -> Any:
        return member(types.int64), lambda context, builder, signature, arguments: arguments[0]

    return convert


INSTRUCTIONS: dict[Any, Any] = {
    float32.float32_bits: float32_bits,
    float32.float32_of: float32_of,
    enums.axis_state_of: _member_of(AxisState),
    enums.operator_request_of: _member_of(OperatorRequest),
}
"""Machine instructions that replace these functions in compiled code."""
