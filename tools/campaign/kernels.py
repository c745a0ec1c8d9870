"""How campaigns compile: kernels that hold the firmware's core, the plant's equations and what joins them.

A process that compiles campaigns was started with `VIBROHIL_COMPILED=1`, so that the core's functions are
compiled ones. As an edited callee goes unnoticed by numba's cache, its folder is named by a hash of all
sources that a kernel may hold.
"""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import config as numba_config

from firmware_py.core.compiled import COMPILED
from hil.compiled import cache_folder

_P = ParamSpec("_P")
_R = TypeVar("_R")

PACKAGES = ("firmware_py", "plant_sim", "hil", "tools/campaign")


class NotCompiledError(RuntimeError):
    """The process runs the firmware interpreted."""


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what Python calls, cached; where the firmware runs interpreted, a call is refused."""
    if not COMPILED:

        @functools.wraps(function)
        def refuse(*_: _P.args, **__: _P.kwargs) -> _R:
            raise NotCompiledError(
                "this process runs the firmware interpreted; "
                "start it with VIBROHIL_COMPILED=1 to run campaigns"
            )

        return refuse
    # numba reads its global cache folder when it decorates; put back, for other packages have their own.
    settings: Any = numba_config
    previous, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder("campaign", PACKAGES))
    try:
        return _compiled(function, cache=True)
    finally:
        settings.CACHE_DIR = previous


def subroutine(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what only kernels call, and are cached with."""
    return _compiled(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compiled(function: Callable[_P, _R], **options: bool) -> Callable[_P, _R]:
    # Without counted references: no kernel makes an array, and counting the many that it hands on to its
    # subroutines is a fifth of the time.
    njit: Any = numba.njit
    result: Callable[_P, _R] = njit(error_model="numpy", _nrt=False, **options)(function)
    return result
