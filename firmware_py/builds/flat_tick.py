"""The firmware as functions on flat memory, in a form that compiles to C functions:

    tick(config *, memory *, int64 behind_ticks, int64 count, frame *, tx *)
    calibrate(config *, memory *)

The structs have the layout of `flat.layout`; `memory` begins with the state, and a frame is three 64-bit
integers. `numba_subset.register` must be called before the function is compiled.
"""

from typing import Any, cast

from numba.core import types

from firmware_py.builds.numba_subset import loader, member_place, numba_type, store
from firmware_py.core.config import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.calibration import calibrate
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import NodeState, Rx, tick
from firmware_py.node.xcp import NO_REQUEST, REQUEST, exchange

_load_config, _load_state = loader(Config), loader(NodeState)
_store = cast(Any, store)
_pointer: Any = types.CPointer
_FRAMES = _pointer(numba_type(WordFrame))
_pool_place = member_place(FirmwareState, "pool", _pointer(types.int64))
CALIBRATE_SIGNATURE = types.void(types.voidptr, types.voidptr)
SIGNATURE = types.void(types.voidptr, types.voidptr, types.int64, types.int64, _FRAMES, types.voidptr)


def flat_tick(config: Any, memory: Any, behind_ticks: int, count: int, frames: Any, tx: Any) -> None:
    """Run one control period."""
    constants = _load_config(config)
    now, sent = tick(constants, _load_state(memory), Rx(behind_ticks, count, frames))
    _store(now, memory)
    _store(exchange(_pool_place(memory), memory, constants.tick_s, now, sent), tx)


def flat_calibrate(config: Any, memory: Any) -> None:
    """Process the waiting request of XCP between two ticks."""
    pool = _pool_place(memory)
    if pool[REQUEST] != NO_REQUEST:
        calibrate(pool, config, _load_state(memory).outputs.mode)
