"""The `compiled` build's one C function, compiled on import or taken from the cache.

    int64 tick(config *, state *, int64 elapsed_ticks, int64 count, frame *, tx *)

The function is `flat_tick`. It returns 1, or 0 with `state` and `tx` unchanged if the arithmetic failed.
"""

from typing import Any

import numba

from firmware_py.builds.cache import cache_folder
from firmware_py.builds.flat_tick import SIGNATURE, flat_tick
from firmware_py.builds.numba_subset import register


def _compiled() -> Any:
    # numba reads its global cache setting when it decorates a function; another package may have set it.
    settings: Any = numba.config
    previous, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder())
    try:
        return numba.cfunc(SIGNATURE, cache=True)(flat_tick)
    finally:
        settings.CACHE_DIR = previous


register()
entry = _compiled()
