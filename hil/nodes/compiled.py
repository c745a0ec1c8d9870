"""Compilation of the closed loop to one kernel from functions of the firmware, the plant and the bench."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from plant_sim.kernels import jit

_P = ParamSpec("_P")
_R = TypeVar("_R")


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that Python calls, with a cache on disk."""
    # Without reference counting, which costs time: no kernel makes an array.
    return jit(function, _nrt=False)
