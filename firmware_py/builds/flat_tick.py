"""The firmware as functions on flat memory, in a form that compiles to C functions:

    receive(memory *, int64 count, frame *)
    advance(config *, memory *, int64 elapsed_ticks) -> int64
    tick(config *, memory *, tx *)
    calibrate(config *, memory *)

The structs have the layout of `flat.layout`; `memory` begins with the state, and a frame is three 64-bit
integers. `numba_subset.register` must be called before the functions are compiled.
"""

from typing import Any, cast

from numba.core import types

from firmware_py.builds.numba_subset import loader, member_place, numba_type, store
from firmware_py.core.config import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.calibration import calibrate
from firmware_py.node.inbox import advance, end_period, receive
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import NodeState, tick
from firmware_py.node.xcp import NO_REQUEST, REQUEST, exchange

_load_config, _load_state = loader(Config), loader(NodeState)
_store = cast(Any, store)
_pointer: Any = types.CPointer
_FRAMES = _pointer(numba_type(WordFrame))
_pool_place = member_place(FirmwareState, "pool", _pointer(types.int64))
_inbox_place = member_place(FirmwareState, "inbox", _pointer(types.int64))


def flat_receive(memory: Any, count: int, frames: Any) -> None:
    """Put frames into the inbox in the order of their arrival."""
    inbox = _inbox_place(memory)
    for place in range(count):
        receive(inbox, frames[place])


def flat_advance(config: Any, memory: Any, elapsed_ticks: int) -> int:
    """Let time pass; the number of ticks to run."""
    state, most_ticks = _load_state(memory), _load_config(config).d.ticks.catch_up
    newest = state.received.accelerometer_arrival
    return advance(_inbox_place(memory), newest, state.ticks, elapsed_ticks, most_ticks)


def flat_tick(config: Any, memory: Any, tx: Any) -> None:
    """Run one control period."""
    constants, inbox = _load_config(config), _inbox_place(memory)
    now, sent = tick(constants, _load_state(memory), inbox)
    end_period(inbox)
    _store(now, memory)
    _store(exchange(_pool_place(memory), memory, constants.tick_s, now, sent), tx)


def flat_calibrate(config: Any, memory: Any) -> None:
    """Process the waiting request of XCP between two ticks."""
    pool = _pool_place(memory)
    if pool[REQUEST] != NO_REQUEST:
        calibrate(pool, config, _load_state(memory).outputs.mode)


_WORD, _ADDRESS = types.int64, types.voidptr
FUNCTIONS: dict[str, tuple[Any, Any]] = {
    "vibro_receive": (flat_receive, types.void(_ADDRESS, _WORD, _FRAMES)),
    "vibro_advance": (flat_advance, _WORD(_ADDRESS, _ADDRESS, _WORD)),
    "vibro_tick": (flat_tick, types.void(_ADDRESS, _ADDRESS, _ADDRESS)),
    "vibro_calibrate": (flat_calibrate, types.void(_ADDRESS, _ADDRESS)),
}
"""The functions by their names in C, with their signatures."""
