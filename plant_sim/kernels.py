"""Compilation in this package: kernels, their subroutines, and functions with one law for each part.

`jit` compiles a kernel, which Python calls; `subroutine` a function that kernels call; `by_part` a function
that has one law for each part of a scene.
"""

import ctypes
import dis
import functools
import typing
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core import config as numba_config
from numba.extending import intrinsic, is_jitted, overload, register_jitable

import compilation.record_replace  # noqa: F401 - defines `_replace` of records in compiled code
from compilation import kernel_cache
from compilation.linking import LINKED

if typing.TYPE_CHECKING:
    from typing_extensions import TypeIs

_P = ParamSpec("_P")
_R = TypeVar("_R")
_R_co = TypeVar("_R_co", covariant=True)
_Law = TypeVar("_Law", bound=Callable[..., Any])
_Part = TypeVar("_Part")


_KERNELS_ONLY: dict[str, Any] = LINKED | {
    "error_model": "numpy",
    "forceinline": False,  # by default it is the caller's
}
IS_INTERPRETED: bool = bool(numba_config.DISABLE_JIT)
"""Whether Python runs the kernels (NUMBA_DISABLE_JIT=1), so that a law can be stepped through."""

MOST_INT64 = 2**63 - 1
"""Largest integer that is compiled as signed."""


def jit(function: Callable[_P, _R], **options: bool) -> Callable[_P, _R]:
    """Compile a kernel: no Python objects, no GIL, IEEE division; kept on disk by the state of its sources.

    `options` are additional ones of numba.
    """
    kernel: Callable[_P, _R] = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if is_jitted(kernel):  # NUMBA_DISABLE_JIT leaves the function as it is
        kernel_cache.keep(kernel)
    return kernel


@typing.overload
def subroutine(function: Callable[_P, _R]) -> Callable[_P, _R]: ...


@typing.overload
def subroutine(*, inline: bool) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]: ...


def subroutine(function: Any = None, *, inline: bool = False) -> Any:
    """Register a function that is compiled in kernels and interpreted when Python calls it.

    Its code is cached with the kernel's. It counts no references to arrays, so it makes and returns none.
    `inline` compiles it as a part of its callers, for the few functions that are called most; if all were
    inlined, compiling would take three times as long.
    """
    if function is None:
        return functools.partial(subroutine, inline=inline)
    return register_jitable(**_KERNELS_ONLY | {"forceinline": inline})(function)


def by_address(kernel: Callable[_P, int], call: Callable[..., int]) -> Callable[_P, int]:
    """A kernel for other kernels, which make the call `call`: `call_at` with its address and its arguments.

    So it is compiled once (`address_of`), and not again as a part of each caller. It returns a status.
    """

    @functools.wraps(kernel)
    def interpreted(*arguments: _P.args, **keywords: _P.kwargs) -> int:
        return kernel(*arguments, **keywords)

    overload(interpreted, strict=False, jit_options={"_nrt": False})(lambda *_: call)
    return interpreted


def address_of(kernel: Callable[..., Any], *arguments: object) -> int:
    """Address of a kernel's machine code for arguments of these types; 0 where Python interprets kernels."""
    entry_point(kernel, *arguments)
    if IS_INTERPRETED:
        return 0
    dispatcher: Any = kernel
    compiled = dispatcher.overloads[_signature(arguments)]
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
    return address


def _call_machine_code(_: Any, address: Any, arguments: Any) -> Any:
    """Call the machine code at an address with a tuple of arguments; it returns an integer."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        unpacked = cgutils.unpack_tuple(builder, values[1])
        kinds = [context.get_value_type(kind) for kind in signature.args[1].types]
        function = builder.inttoptr(values[0], ir.FunctionType(ir.IntType(64), kinds).as_pointer())
        return builder.call(function, unpacked)

    return types.int64(address, arguments), generate


call_at = intrinsic(_call_machine_code)

_ENTRY_POINTS: dict[Any, Callable[..., Any]] = {}
"""Machine code by kernel and kinds of its arguments; numba takes a millisecond to find the types again."""


FROM_COMPILED = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 3)
"""Gives a `PythonCall` an address for `call_at`, as long as the result has a name."""


class PythonCall:
    """A function of three integers as compiled code calls it; an exception in it ends that code."""

    def __init__(self, function: Callable[[int, int, int], int], stop: Callable[[], None]) -> None:
        """`stop`: what lets the compiled code end after an exception, which is then in `error`."""
        self.error: BaseException | None = None
        self._function, self._stop = function, stop

    def __call__(self, which: int, first: int, end: int) -> int:
        """Call the function, unless it has failed before."""
        try:
            return first if self.error else self._function(which, first, end)
        except BaseException as error:
            self.error = error
            self._stop()
            return first


def entry_point(kernel: Callable[..., _R], *arguments: object) -> Callable[..., _R]:
    """Machine code of a kernel for arguments of these types, compiled or loaded now.

    A call of it skips the look-up of the arguments' types, which takes longer than a short kernel for nested
    records. The caller must keep to these types; the numbers of a record count as declared.
    """
    if IS_INTERPRETED:
        return kernel
    key = kernel, *map(kind_of, arguments)
    if key not in _ENTRY_POINTS:
        dispatcher: Any = kernel
        signature = _signature(arguments)
        dispatcher.compile(signature)
        _ENTRY_POINTS[key] = dispatcher.overloads[signature].entry_point
    return _ENTRY_POINTS[key]


def _signature(arguments: tuple[object, ...]) -> tuple[types.Type, ...]:
    return tuple(numba.typeof(_as_declared(argument)) for argument in arguments)


def kind_of(value: object) -> Any:
    """A key of the compiled type of a value."""
    if hasattr(value, "numba_type"):
        return value.numba_type
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
    if isinstance(value, np.generic):
        return value.dtype
    if type(value) is int:
        return int, value > MOST_INT64
    if not isinstance(value, tuple):
        return type(value)
    declared = getattr(value, "__annotations__", {})
    names = getattr(value, "_fields", range(len(value)))
    fields = zip(names, value, strict=True)
    return type(value), *(float if declared.get(name) is float else kind_of(field) for name, field in fields)


def _as_declared(value: object) -> Any:
    """The value, with a float wherever a record declares one.

    Otherwise an int in its place would be compiled as an int, and later floats would be truncated.
    """
    if not isinstance(value, tuple):
        return value
    if not hasattr(value, "_fields"):
        return tuple(map(_as_declared, value))
    kind: Any = type(value)
    declared = kind.__annotations__
    return kind._make(
        float(field) if declared[name] is float else _as_declared(field)
        for name, field in zip(kind._fields, value, strict=True)
    )


_MEMBERS: dict[Any, tuple[type, ...]] = {}
"""The parts that a slot's record can hold, by the record's type; `kind` is a part's place among them."""


def register_kinds(record: type, members: tuple[type, ...]) -> None:
    """Let the laws for the parts `members` apply to `record`, by its field `kind` at run time."""
    _MEMBERS[record] = members


class ByPart(Protocol[_P, _R_co]):
    """A function with one law for each type of its first argument."""

    def __call__(self, *arguments: _P.args, **keywords: _P.kwargs) -> _R_co:
        """Apply the law of the first argument."""

    def register(self, *parts: type) -> Callable[[_Law], _Law]:
        """Register the decorated function as the law for these types of part."""


def by_part(generic: Callable[_P, _R]) -> ByPart[_P, _R]:
    """A function with one law for each type of its first argument, as `functools.singledispatch` has it.

    Laws are added with `@generic.register(PartType)`, in the file of the generic function or of the part. In
    kernels a slot's record (`plant_sim.kinds`) selects its part's law by `kind`, at run time; any other
    record has one law, selected when the kernel is compiled. The body of the generic function is the law of
    all other parts; if it raises NotImplementedError, each part needs a law. The same call also works
    interpreted.

    >>> from typing import NamedTuple
    >>> class Sphere(NamedTuple):
    ...     radius_m: float
    >>> @by_part
    ... def volume_m3(body): ...
    >>> @volume_m3.register(Sphere)
    ... def sphere_volume_m3(body):
    ...     return 4.0 / 3.0 * 3.14159 * body.radius_m**3
    >>> round(volume_m3(Sphere(1.0)), 3)
    4.189
    >>> @by_part
    ... def edges(body):
    ...     return 0
    >>> edges(Sphere(1.0))
    0
    """
    laws: dict[type, Callable[..., Any]] = {}
    default = None if "NotImplementedError" in generic.__code__.co_names else generic
    by_kind: dict[type, Callable[..., Any]] = {}

    @functools.wraps(generic)
    def interpreted(part: Any, *arguments: Any) -> Any:
        return laws.get(type(part), generic)(part, *arguments)

    def compiled(part: types.Type, *arguments: types.Type) -> Callable[..., Any] | None:
        record = getattr(part, "instance_class", type(None))
        if record not in _MEMBERS:
            return laws.get(record, default)
        if record not in by_kind:
            chosen = [laws.get(member, default) for member in _MEMBERS[record]]
            by_kind[record] = _choose_by_kind(generic.__name__, chosen, len(arguments))
        return by_kind[record]

    def register(*parts: type) -> Callable[[_Law], _Law]:
        def add(law: _Law) -> _Law:
            for part in parts:
                if law.__module__ not in (generic.__module__, part.__module__):
                    raise TypeError(
                        f"{law.__module__}.{law.__qualname__} is a law of {generic.__name__} for "
                        f"{part.__name__}; a kernel is cached by what it imports, so put the law into "
                        f"{generic.__module__} or {part.__module__}"
                    )
                laws[part] = law
            return law

        return add

    overload(interpreted, strict=False, jit_options=_KERNELS_ONLY | {"forceinline": True})(compiled)
    dispatching: Any = interpreted
    dispatching.register = register
    return cast("ByPart[_P, _R]", dispatching)


def _choose_by_kind(name: str, laws: list[Callable[..., Any] | None], count: int) -> Callable[..., Any]:
    """The function `name` of a record and `count` arguments that calls the law of the record's kind.

    `laws` by kind; None where the part has no law.
    """
    arguments = ", ".join(["part", *(f"argument_{number}" for number in range(count))])
    kinds: dict[Any, list[int]] = {}
    for kind, one in enumerate(laws):
        kinds.setdefault(one, []).append(kind)
    if None in kinds:
        raise TypeError(f"{name} has no law for kinds {kinds[None]}; each part of a slot needs one")
    # The law of most kinds comes last, without a condition.
    ordered = sorted(kinds.items(), key=lambda item: len(item[1]))
    scope: dict[str, Any] = {}
    lines = [f"def {name}_by_kind({arguments}):"]
    for number, (one, its_kinds) in enumerate(ordered):
        scope[f"law_{number}"] = _compiled_law(one)
        result = f"return {_constant(one) or f'law_{number}({arguments})'}"
        if number == len(ordered) - 1:
            lines.append(f"    {result}")
        else:
            condition = " or ".join(f"part.kind == {kind}" for kind in its_kinds)
            lines.append(f"    if {condition}:\n        {result}")
    exec("\n".join(lines), scope)  # numba cannot select among functions; this text is only generated calls
    chosen: Callable[..., Any] = scope[f"{name}_by_kind"]
    return chosen


@functools.cache
def _compiled_law(one: Callable[..., Any]) -> Callable[..., Any]:
    """A law as a part of its callers: the constants of a kernel reach it, which saves a tenth of a tick."""
    return subroutine(inline=True)(one)


def _constant(one: Callable[..., Any]) -> str | None:
    """The text of a number that is all the law returns: it needs no function. None for other laws."""
    steps = [step for step in dis.get_instructions(one) if step.opname not in ("RESUME", "NOP")]
    if [step.opname for step in steps] in (["RETURN_CONST"], ["LOAD_CONST", "RETURN_VALUE"]):
        return repr(steps[0].argval)
    return None


@typing.overload
def one_of(part: type[_Part], /) -> "Callable[[Any], TypeIs[_Part]]": ...


@typing.overload
def one_of(*parts: type) -> Callable[[Any], bool]: ...


def one_of(*parts: type) -> Callable[[Any], bool]:
    """A predicate: whether a part is of one of these types; in kernels it tests the `kind` of a record.

    A law that most parts lack is one function with a branch on such a predicate.
    """

    @by_part
    def is_one(part: Any) -> bool:
        return False

    @is_one.register(*parts)
    def is_this(part: Any) -> bool:
        return True

    return is_one
