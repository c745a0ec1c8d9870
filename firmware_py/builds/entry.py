"""The `compiled` build's one C function, compiled on import or taken from the cache.

    int64 tick(config *, state *, int64 behind_ticks, int64 count, frame *, tx *)

The function is `flat_tick`. It returns 1, or 0 with `state` and `tx` unchanged if the arithmetic failed.
"""

from typing import Any

from numba.core import sigutils
from numba.core.ccallback import CFunc

import firmware_py.builds.replacements  # noqa: F401 - a part of the code, so of the cache's key
import kernel_cache
from firmware_py.builds.flat_tick import SIGNATURE, flat_tick
from firmware_py.builds.numba_subset import register


def _compiled() -> Any:
    numba_signature: Any = sigutils  # without types
    signature = numba_signature.normalize_signature(SIGNATURE)
    callback: Any = CFunc(flat_tick, signature, locals={}, options={})
    kernel_cache.keep(callback)
    callback.compile()  # numba's decorator would compile before the cache is set
    return callback


register()
entry = _compiled()
