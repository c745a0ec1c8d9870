"""The firmware as one function on flat memory, in a form that compiles to one C function:

    tick(config *, state *, int64 elapsed_ticks, int64 count, frame *, tx *)

The structs have the layout of `flat.layout`; a frame is three 64-bit integers. `numba_subset.register` must
be called before the function is compiled.
"""

from typing import Any, cast

from numba.core import types

from firmware_py.builds.numba_subset import loader, numba_type, store
from firmware_py.core.state import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.tick import NodeState, Rx, tick

_load_config, _load_state, _store = loader(Config), loader(NodeState), cast(Any, store)
_pointer: Any = types.CPointer
_FRAMES = _pointer(numba_type(WordFrame))
SIGNATURE = types.int64(types.voidptr, types.voidptr, types.int64, types.int64, _FRAMES, types.voidptr)


def flat_tick(config: Any, state: Any, elapsed_ticks: int, count: int, frames: Any, tx: Any) -> int:
    """Run one control period; always returns 1."""
    now, sent = tick(_load_config(config), _load_state(state), Rx(elapsed_ticks, count, frames))
    _store(now, state)
    _store(sent, tx)
    return 1
