"""One source, two ways to run it: interpreted as shipped, compiled by numba for campaigns.

A process started with `VIBROHIL_COMPILED=1` compiles every function of the core; in any other process the
decorator hands the function back untouched. numba's cache notices an edited function but neither an edited
callee nor a reordered record, so the folder of the cache is named by a hash of every source file of the
firmware.

The core builds by position, in the order of their fields, the records that it makes in every tick: their
keywords cost the interpreter a tenth of the tick. All others name their fields.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

COMPILED = os.environ.get("VIBROHIL_COMPILED") == "1"
"""Whether this process runs the core compiled."""

Function = TypeVar("Function", bound=Callable[..., Any])


def interpreted(function: Function) -> Function:
    """`function` as Python runs it: for the single call that is not worth compiling."""
    return cast(Function, getattr(function, "py_func", function))


def source_hash() -> str:
    """A hash of all Python sources of the firmware, names included."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where compiled code is kept: $VIBROHIL_CACHE_DIR, else vibrohil/ under the user's cache folder."""
    chosen = os.environ.get("VIBROHIL_CACHE_DIR")
    if chosen:
        return Path(chosen) / f"firmware-{source_hash()}"
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return user_cache / "vibrohil" / f"firmware-{source_hash()}"


if COMPILED:
    import numba

    _SETTINGS: Any = numba.config
    _CACHE_FOLDER = str(cache_folder())

    def compiled(function: Function) -> Function:
        """`function`, compiled at its first call."""
        # numba reads its one global cache setting when it decorates; other packages have set theirs.
        others, _SETTINGS.CACHE_DIR = _SETTINGS.CACHE_DIR, _CACHE_FOLDER
        try:
            result: Any = numba.njit(cache=True)(function)
        finally:
            _SETTINGS.CACHE_DIR = others
        return cast(Function, result)

else:

    def compiled(function: Function) -> Function:
        """`function` itself."""
        return function
