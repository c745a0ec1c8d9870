"""Compilation of the closed loop to one kernel from functions of the firmware, the plant and the bench."""

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from plant_sim.kernels import cache_folder, cached

_P = ParamSpec("_P")
_R = TypeVar("_R")

PACKAGES = ("firmware_py", "plant_sim", "hil")
"""Packages whose sources may be part of the kernel."""


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that Python calls, with a cache on disk."""
    root = Path(__file__).parents[2]
    folder = cache_folder("loop", tuple(root / package for package in PACKAGES))
    # Without reference counting, which costs time: no kernel makes an array.
    return cached(function, folder, _nrt=False)
