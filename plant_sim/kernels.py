"""Compilation in this package: one `jit`, and functions that the type of a part selects at compile time.

numba's cache checks only the file of the cached function. After an edit of a callee in another file, of the
order of a record or of an enum's value, stale machine code would run. The cache folder is therefore named by
a hash of all sources of the package, so that each edit starts a new folder.
"""

import functools
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import config as numba_config
from numba.core import types
from numba.extending import overload, register_jitable

from plant_sim.linking import SubroutineCompiler

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Generic = TypeVar("_Generic", bound=Callable[..., Any])
_Law = TypeVar("_Law", bound=Callable[..., Any])


_KERNELS_ONLY: dict[str, Any] = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,
    "pipeline_class": SubroutineCompiler,
}
_HERE = Path(__file__).parent

MOST_INT64 = 2**63 - 1
"""Largest integer that is compiled as signed."""


class KernelCacheError(OSError):
    """The folder for compiled kernels cannot be written."""


@functools.cache
def cache_folder(name: str = "plant_sim", packages: tuple[Path, ...] = (_HERE,)) -> Path:
    """Folder of the compiled kernels of these packages, below $VIBROHIL_CACHE_DIR or the user's cache."""
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    root = Path(os.environ.get("VIBROHIL_CACHE_DIR") or user_cache / "vibrohil")
    folder = root / f"{name}-{_source_hash(packages)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise KernelCacheError(
            f"compiled kernels are kept in {folder}, which cannot be written ({error.strerror}); "
            "set VIBROHIL_CACHE_DIR to a writable folder"
        ) from error
    return folder


def _source_hash(packages: tuple[Path, ...]) -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for package in packages:
        for source in sorted(package.rglob("*.py")):
            digest.update(source.relative_to(package.parent).as_posix().encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def jit(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel: no Python objects, no GIL, IEEE division, cached per source state and types."""
    return cached(function, cache_folder())


def inlined_kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel that Python calls and that is also a part of other kernels (see `inlined`).

    It makes no arrays, so it counts no references to them.
    """
    return cached(function, cache_folder(), forceinline=True, _nrt=False)


def cached(function: Callable[_P, _R], folder: Path, **options: bool) -> Callable[_P, _R]:
    """Compile a kernel with additional options of numba and cache it in `folder`."""
    # numba reads its global cache folder when it decorates; put back, for other packages have their own.
    settings: Any = numba_config
    previous, settings.CACHE_DIR = settings.CACHE_DIR, str(folder)
    try:
        njit: Any = numba.njit
        kernel: Callable[_P, _R] = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        settings.CACHE_DIR = previous
    return kernel


def subroutine(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that only kernels call; its code is cached with theirs.

    It has no entry point for Python, which is long for nested records, and counts no references to arrays;
    this shortens the compile time of a scene's kernel, and its run time.
    """
    njit: Any = numba.njit
    kernel: Callable[_P, _R] = njit(nogil=True, **_KERNELS_ONLY)(function)
    return kernel


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a subroutine as a part of its callers.

    A call copies its arguments. Records of some 150 numbers cost up to a microsecond, as the copies on the
    stack may lie a multiple of 4 KiB from what is read next, which then waits for them.
    """
    njit: Any = numba.njit
    kernel: Callable[_P, _R] = njit(nogil=True, forceinline=True, **_KERNELS_ONLY)(function)
    return kernel


def allocating(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a subroutine that makes arrays; others count no references, so they make and return none."""
    njit: Any = numba.njit
    kernel: Callable[_P, _R] = njit(nogil=True, **_KERNELS_ONLY | {"_nrt": True})(function)
    return kernel


def shared(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Register a function that is compiled in kernels and interpreted when Python calls it."""
    decorate: Any = register_jitable(**_KERNELS_ONLY)
    plain: Callable[_P, _R] = decorate(function)
    return plain


_ENTRY_POINTS: dict[Any, Callable[..., Any]] = {}
"""Machine code by kernel and kinds of its arguments; numba takes a millisecond to find the types again."""


def entry_point(kernel: Callable[..., _R], *arguments: object) -> Callable[..., _R]:
    """Machine code of a kernel for arguments of these types, compiled or loaded now.

    A call of it skips the look-up of the arguments' types, which takes longer than a short kernel for nested
    records. The caller must keep to these types; the numbers of a record count as declared.
    """
    key = kernel, *map(_kind, arguments)
    if key not in _ENTRY_POINTS:
        dispatcher: Any = kernel
        typeof: Callable[[object], types.Type] = numba.typeof
        signature = tuple(typeof(_as_declared(argument)) for argument in arguments)
        dispatcher.compile(signature)
        _ENTRY_POINTS[key] = dispatcher.overloads[signature].entry_point
    return _ENTRY_POINTS[key]


def _kind(value: object) -> Any:
    """What determines the compiled type of a value."""
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
    return type(value), *(float if declared.get(name) is float else _kind(field) for name, field in fields)


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


def by_part(generic: _Generic) -> _Generic:
    """A function with one law per type of its first argument, selected when a kernel is compiled.

    Laws are added with `@law(generic, PartType)`; a kernel that calls the generic function then contains only
    the law of the scene's own part. The body of the generic function is the law of all other parts; if it
    raises NotImplementedError, each part needs a law. The same call also works interpreted.

    >>> from typing import NamedTuple
    >>> class Sphere(NamedTuple):
    ...     radius_m: float
    >>> @by_part
    ... def volume_m3(body): ...
    >>> @law(volume_m3, Sphere)
    ... def _(body):
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

    @functools.wraps(generic)
    def interpreted(part: Any, *arguments: Any) -> Any:
        return laws.get(type(part), generic)(part, *arguments)

    def compiled(part: types.Type, *arguments: types.Type) -> Callable[..., Any] | None:
        return laws.get(getattr(part, "instance_class", type(None)), default)

    options: Any = _KERNELS_ONLY
    overload(interpreted, strict=False, jit_options=options)(compiled)
    interpreted.laws = laws  # type: ignore[attr-defined]  # read by `law` alone
    return interpreted  # type: ignore[return-value]  # keeps the generic function's own signature for callers


def law(generic: Callable[..., Any], *parts: type) -> Callable[[_Law], _Law]:
    """Register the decorated function as the law of `generic` for these types of part."""

    def register(function: _Law) -> _Law:
        laws: dict[type, Callable[..., Any]] = generic.laws  # type: ignore[attr-defined]  # set by `by_part`
        for part in parts:
            laws[part] = function
        return function

    return register


def one_of(*parts: type) -> Callable[[Any], bool]:
    """A predicate: whether a part is of one of these types. Kernels evaluate it when they are compiled."""

    @by_part
    def is_one(part: Any) -> bool:
        return False

    @law(is_one, *parts)
    def _(part: Any) -> bool:
        return True

    return is_one
