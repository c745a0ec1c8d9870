"""The firmware's one C function, compiled on import or taken from the cache.

    int64 tick(config *, state *, int64 elapsed_ticks, int64 count, frame *, tx *)

It returns 1, or 0 with `state` and `tx` unchanged where the arithmetic failed. The structs are those of
`flat.layout`; a frame is three 64-bit integers.
"""

from typing import Any, cast

import numba
from numba.core import types

from firmware_py.builds.numba_subset import loader, numba_type, register, store
from firmware_py.core.compiled import cache_folder
from firmware_py.core.step import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.tick import NodeState, Rx, tick

register()

_load_config, _load_state, _store = loader(Config), loader(NodeState), cast(Any, store)
_pointer: Any = types.CPointer
_FRAMES = _pointer(numba_type(WordFrame))
_SIGNATURE = types.int64(types.voidptr, types.voidptr, types.int64, types.int64, _FRAMES, types.voidptr)


def _entry(config: Any, state: Any, elapsed_ticks: int, count: int, frames: Any, tx: Any) -> int:
    now, sent = tick(_load_config(config), _load_state(state), Rx(elapsed_ticks, count, frames))
    _store(now, state)
    _store(sent, tx)
    return 1


def _compiled() -> Any:
    # numba reads its one global cache setting when it decorates; other packages have set theirs.
    settings: Any = numba.config
    previous, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder())
    try:
        return numba.cfunc(_SIGNATURE, cache=True)(_entry)
    finally:
        settings.CACHE_DIR = previous


entry = _compiled()
