"""How the closed loop compiles: one kernel of the firmware's, the plant's and the bench's own functions.

numba's cache notices neither an edited callee nor a reordered record, so the folder of the cache is named by
a hash of all sources that the kernel may hold.
"""

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import config as numba_config

_P = ParamSpec("_P")
_R = TypeVar("_R")

PACKAGES = ("firmware_py", "plant_sim", "hil")


@functools.cache
def cache_folder(name: str, packages: tuple[str, ...]) -> Path:
    """Where kernels of these packages are kept: $VIBROHIL_CACHE_DIR, else vibrohil/ in the user's cache."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256(numba.__version__.encode())
    for package in packages:
        for source in sorted((root / package).rglob("*.py")):
            digest.update(source.relative_to(root).as_posix().encode())
            digest.update(source.read_bytes())
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    chosen = Path(os.environ.get("VIBROHIL_CACHE_DIR") or user_cache / "vibrohil")
    folder = chosen / f"{name}-{digest.hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what Python calls, cached."""
    # numba reads its global cache folder when it decorates; put back, for other packages have their own.
    settings: Any = numba_config
    previous, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder("loop", PACKAGES))
    try:
        # Without counted references: no kernel makes an array, and counting what it hands on costs time.
        njit: Any = numba.njit
        compiled: Callable[_P, _R] = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function)
    finally:
        settings.CACHE_DIR = previous
    return compiled
