"""The firmware compiled by numba for this machine, in double precision, as C functions on flat memory:

    receive(memory *, int64 count, frame *)
    advance(config *, memory *, int64 elapsed_ticks) -> the number of ticks to run
    tick(config *, memory *, tx *)

The structs have the layout of `flat.layout`; `memory` begins with the state, and a frame is three 64-bit
integers. Division is IEEE 754's, as in the emitted C. The kernels are kept on disk as all others are.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import numba
from numba.core import types
from numba.core.ccallback import CFunc

from compilation.kernel_cache import keep
from firmware_py.builds.numba_subset import loader, member_at, numba_type, register, store
from firmware_py.core.config import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node import inbox, xcp
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import NodeState
from firmware_py.node.tick import tick as node_tick

_load_config, _load_state = loader(Config), loader(NodeState)
_store = cast(Any, store)
_pointer: Any = types.CPointer
_pool_at = member_at(FirmwareState, "pool", _pointer(types.int64))
_inbox_at = member_at(FirmwareState, "inbox", _pointer(types.int64))


def receive(memory: Any, count: int, frames: Any) -> None:
    """Put frames into the inbox in the order of their arrival."""
    waiting = _inbox_at(memory)
    for index in range(count):
        inbox.receive(waiting, frames[index])


def advance(config: Any, memory: Any, elapsed_ticks: int) -> int:
    """Let time pass; the number of ticks to run."""
    state, most_ticks = _load_state(memory), _load_config(config).catch_up_ticks
    newest = state.received.accelerometer_arrival
    return inbox.advance(_inbox_at(memory), newest, state.ticks, elapsed_ticks, most_ticks)


def tick(config: Any, memory: Any, tx: Any) -> None:
    """Run one control period."""
    constants, waiting = _load_config(config), _inbox_at(memory)
    now, sent = node_tick(constants, _load_state(memory), waiting)
    inbox.end_period(waiting)
    _store(now, memory)
    _store(xcp.exchange(_pool_at(memory), memory, constants.tick_s, now, sent), tx)


_WORD, _ADDRESS = types.int64, types.voidptr
_FRAMES = _pointer(numba_type(WordFrame))
FUNCTIONS: dict[str, tuple[Callable[..., int | None], Any]] = {
    "vibro_receive": (receive, types.void(_ADDRESS, _WORD, _FRAMES)),
    "vibro_advance": (advance, types.int32(_ADDRESS, _ADDRESS, _WORD)),
    "vibro_tick": (tick, types.void(_ADDRESS, _ADDRESS, _ADDRESS)),
}
"""The functions by their names in C, with their signatures."""
OPTIONS = {"error_model": "numpy", "_nrt": False}


@contextmanager
def compiling() -> Iterator[None]:
    """Compile even where kernels are interpreted (NUMBA_DISABLE_JIT), to step through the plant."""
    kept, numba.config.DISABLE_JIT = numba.config.DISABLE_JIT, 0
    try:
        yield
    finally:
        numba.config.DISABLE_JIT = kept


@functools.cache
def kernels() -> dict[str, Any]:
    """numba's C callbacks by their names in C; the first time they take half a minute."""
    register()
    found: dict[str, Any] = {}
    callback: Any = CFunc
    with compiling():
        for name, (function, signature) in FUNCTIONS.items():
            kernel = callback(function, (signature.args, signature.return_type), {}, OPTIONS)
            keep(kernel)
            kernel.compile()
            found[name] = kernel
    return found
