"""A function of the firmware as the compiled build runs it."""

from collections.abc import Callable
from typing import Any

from numba import njit

from firmware_py.builds.numba_subset import register


def as_compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function`, called from compiled code."""
    register()

    @njit
    def called(*arguments: Any) -> Any:
        return function(*arguments)

    compiled: Callable[..., Any] = called
    return compiled
