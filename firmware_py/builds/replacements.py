"""Functions of the firmware that compiled code replaces.

These are filterpy's algebra, by the same algebra written out; the reading of a measurement, by its place in
memory; the parameters in use, in memory too; and whether the gait is built in.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, register_jitable

from firmware_py.builds.machine_code import GAIT_CONSTANT
from firmware_py.builds.numba_subset import (
    float32_bits,
    float32_of,
    loader,
    member_place,
    numba_type,
    store,
)
from firmware_py.core.config import Config, Derived
from firmware_py.core.configure import derive_tuning_constants
from firmware_py.core.estimation import kalman
from firmware_py.core.gait import follow
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.node import calibration, places, xcp
from firmware_py.node.tick import NodeState

LONG, WORD, SHORT, BYTE = ir.IntType(64), ir.IntType(32), ir.IntType(16), ir.IntType(8)
FLOAT_KIND, INTEGER_KIND, TRUTH_KIND = range(3)
UNROLLED = 4


def _constant_table(builder: Any, name: str, item: Any, values: Any) -> Any:
    """A constant array of the module, made once."""
    if name not in builder.module.globals:
        table = ir.GlobalVariable(builder.module, ir.ArrayType(item, len(values)), name)
        table.global_constant, table.linkage = True, "internal"
        table.initializer = ir.Constant(table.type.pointee, values)
    return builder.module.globals[name]


@intrinsic
def kind_of_place(_: Any, place: types.Type) -> Any:
    """The kind of a measurement: float, integer or truth value."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        order: dict[type, int] = {float: FLOAT_KIND, bool: TRUTH_KIND}
        kinds = [BYTE(order.get(one.kind, INTEGER_KIND)) for one in places.ALL]
        table = _constant_table(builder, "vibro_place_kinds", BYTE, kinds)
        found = builder.load(builder.gep(table, [WORD(0), builder.trunc(arguments[0], WORD)]))
        return builder.zext(found, ir.IntType(64))

    return types.int64(types.int64), generate


def member_pointer(
    context: Any, builder: Any, kind: Any, paths: Any, arguments: tuple[Any, Any], item: Any = LONG
) -> Any:
    """A pointer to an `item` at a record's member; `arguments`: the record's address, the index of the path.

    The offsets are constant expressions over the record's type, so that they follow it into single precision.
    They have 16 bits, as a record is shorter than 64 kB.
    """
    address, index = arguments
    record = context.data_model_manager[numba_type(kind)].get_data_type()
    start = ir.Constant(record.as_pointer(), None)
    offsets = [start.gep([WORD(0), *map(WORD, path)]).ptrtoint(SHORT) for path in paths]
    table = _constant_table(builder, f"vibro_{kind.__name__}_offsets", SHORT, offsets)
    offset = builder.zext(builder.load(builder.gep(table, [WORD(0), builder.trunc(index, WORD)])), WORD)
    inner = builder.gep(builder.bitcast(address, BYTE.as_pointer()), [offset])
    return builder.bitcast(inner, item.as_pointer())


def load_member(context: Any, builder: Any, address: Any, place: Any) -> Any:
    """The eight bytes from a measurement's address on in the state at `address`, the member's and others."""
    paths = [one.path for one in places.ALL]
    pointer = member_pointer(context, builder, NodeState, paths, (address, place))
    return builder.load(pointer, align=1)


@intrinsic
def member_at(_: Any, address: types.Type, place: types.Type) -> Any:
    """`load_member` for compiled code."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return load_member(context, builder, *arguments)

    return types.int64(address, place), generate


@intrinsic
def float_in(_: Any, member: types.Type) -> Any:
    """The float in a measurement's bytes, whose first four are the float in single precision."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        memory = builder.alloca(LONG)
        builder.store(arguments[0], memory)
        return builder.load(builder.bitcast(memory, ir.DoubleType().as_pointer()))

    return types.float64(types.int64), generate


def latch_function(context: Any, module: Any) -> Any:
    """`vibro_latch(state, pool, source, target, count)`: `places.latch` in LLVM's terms.

    It is never inlined, because the loop would lack registers within the tick; the counting of
    the loop is shared by `UNROLLED` measurements.
    """
    arguments = [BYTE.as_pointer(), LONG.as_pointer(), WORD, WORD, WORD]
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), arguments), "vibro_latch")
    function.linkage = "internal"
    function.attributes.add("noinline")
    state, pool, source, target, count = function.args
    builder = ir.IRBuilder(function.append_basic_block())

    def copy(index: Any) -> None:
        place = builder.load(builder.gep(pool, [builder.add(source, index)]))
        member = load_member(context, builder, state, place)
        builder.store(member, builder.gep(pool, [builder.add(target, index)]))

    whole = builder.and_(count, WORD(-UNROLLED))
    with cgutils.for_range_slice(builder, WORD(0), whole, WORD(UNROLLED), WORD) as (index, _):
        for step in range(UNROLLED):
            copy(builder.add(index, WORD(step)))
    with cgutils.for_range_slice(builder, whole, count, WORD(1), WORD) as (index, _):
        copy(index)
    builder.ret_void()
    return function


@intrinsic
def copy_members(
    _: Any, memory: types.Type, pool: types.Type, source: types.Type, target: types.Type, count: types.Type
) -> Any:
    """`vibro_latch` for compiled code."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        made = builder.module.globals.get("vibro_latch") or latch_function(context, builder.module)
        memory, pool, *numbers = arguments
        builder.call(made, [memory, pool, *(builder.trunc(number, WORD) for number in numbers)])
        return context.get_dummy_value()

    return types.none(memory, pool, source, target, count), generate


def _latch(memory: Any, pool: Any, source: int, target: int, count: int) -> None:
    """`places.latch` of the state at the address `memory`."""
    copy_members(memory, pool, source, target, count)  # type: ignore[call-arg, arg-type]  # numba adds one


def _word_of(latched: int, place: int) -> int:
    """`places.word_of` of the eight bytes from a member's address on."""
    kind = kind_of_place(place)  # type: ignore[call-arg, var-annotated]  # numba adds the first argument
    if kind == FLOAT_KIND:
        return float32_bits(float_in(latched))
    return latched & (0xFFFFFFFF if kind == INTEGER_KIND else 0xFF)


def _word_at(memory: Any, place: int) -> int:
    """`places.word_at` of the state at the address `memory`."""
    member = member_at(memory, place)  # type: ignore[call-arg, arg-type, var-annotated]  # numba adds one
    return places.word_of(member, place)


@intrinsic
def parameter_member(_: Any, address: types.Type, place: types.Type) -> Any:
    """The eight bytes from a parameter's address on, in the parameters at `address`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = member_pointer(context, builder, Parameters, calibration.PATHS, arguments)
        return builder.load(pointer, align=1)

    return types.int64(address, place), generate


@intrinsic
def put_parameter(_: Any, address: types.Type, place: types.Type, value: types.Type) -> Any:
    """Store a parameter, an integer or a float as its member is, in the parameters at `address`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *where, content = arguments
        pointer = member_pointer(context, builder, Parameters, calibration.PATHS, where, content.type)
        builder.store(content, pointer)
        return context.get_dummy_value()

    return types.none(address, place, value), generate


@intrinsic
def room_for_parameters(_: Any) -> Any:
    """The address of memory for `Parameters`, as long as the function runs."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        record = context.data_model_manager[numba_type(Parameters)].get_data_type()
        room = cgutils.alloca_once(builder, record)  # type: ignore[no-untyped-call]
        return builder.bitcast(room, context.get_value_type(types.voidptr))

    return types.voidptr(), generate


_parameters_place, _derived_place = member_place(Config, "p"), member_place(Config, "d")
_load_parameters, _load_derived = loader(Parameters), loader(Derived)
_store: Any = store


@register_jitable
def put_page(config: Any, pool: Any, target: Any) -> None:
    """Store the parameters in use, with those staged values that differ, at the address `target`."""
    for place in range(xcp.COUNT):
        value = float32_of(pool[xcp.PAGE_AT + place])  # type: ignore[call-arg, var-annotated]
        if calibration.WHOLES[place]:
            put_parameter(target, place, int(value))
        elif pool[xcp.PAGE_AT + place] != calibration.bits_in_use(config, place):
            put_parameter(target, place, value)
        else:
            member = parameter_member(_parameters_place(config), place)
            put_parameter(target, place, float_in(member))


def _bits_in_use(config: Any, place: int) -> int:
    """`calibration.bits_in_use` of the config at an address."""
    member = parameter_member(_parameters_place(config), place)  # type: ignore[call-arg, arg-type, var-annotated]
    if calibration.WHOLES[place]:
        return float32_bits(float(member))
    return float32_bits(float_in(member))


def _with_page(config: Any, pool: Any) -> Any:
    """`calibration.with_page` of the config at an address."""
    room = room_for_parameters()  # type: ignore[call-arg, var-annotated]
    put_page(config, pool, room)
    return _load_parameters(room)


def _apply(config: Any, p: Any, pool: Any) -> Any:
    """`calibration.apply` to the config at an address."""
    place = _derived_place(config)
    _store(derive_tuning_constants(p, _load_derived(place)), place)
    put_page(config, pool, _parameters_place(config))
    return config


@intrinsic
def gait_constant(_: Any) -> Any:
    """The constant `GAIT_CONSTANT`, by which LLVM leaves out the gait where an object sets it to 0."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(
            builder.gep(_constant_table(builder, GAIT_CONSTANT, BYTE, [1]), [WORD(0), WORD(0)])
        )

    return types.uint8(), generate


def _is_built_in() -> bool:
    """`follow.is_built_in`, by a constant of the object."""
    return gait_constant() != 0  # type: ignore[call-arg]  # numba adds the first argument


INSTEAD: dict[Any, Any] = {
    kalman.predict: kalman.predict_written_out,
    kalman.update: kalman.update_written_out,
    places.latch: _latch,
    places.word_of: _word_of,
    places.word_at: _word_at,
    calibration.bits_in_use: _bits_in_use,
    calibration.with_page: _with_page,
    calibration.apply: _apply,
    follow.is_built_in: _is_built_in,
}
"""What replaces each function in compiled code, by function."""
