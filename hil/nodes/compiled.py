"""How the closed loop compiles: one kernel of the firmware's, the plant's and the bench's own functions."""

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from plant_sim.kernels import cache_folder, cached

_P = ParamSpec("_P")
_R = TypeVar("_R")

PACKAGES = ("firmware_py", "plant_sim", "hil")
"""All whose sources the kernel may hold."""


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what Python calls, cached."""
    root = Path(__file__).parents[2]
    folder = cache_folder("loop", tuple(root / package for package in PACKAGES))
    # Without counted references: no kernel makes an array, and counting what it hands on costs time.
    return cached(function, folder, _nrt=False)
