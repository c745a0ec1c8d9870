"""Nodes whose firmware is an object file in this process; compiled code can call it, by address."""

import ctypes
import functools
from typing import Any, NamedTuple, cast

from firmware_py.builds.flat import Memory, Precision, copier, to_precision
from firmware_py.builds.loaded_object import load_function
from firmware_py.builds.machine_code import TARGETS, HostName, object_code
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.flat_node import FlatNode

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
TYPES = {
    "vibro_receive": ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, INTEGER, POINTER),
    "vibro_advance": ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, POINTER, INTEGER),
    "vibro_tick": ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, POINTER, POINTER),
}


class Native(NamedTuple):
    """The addresses of `vibro_receive` and `vibro_tick` in this process, and the memory on which they work.

    `vibro_tick` returns 0 unless its arithmetic has failed.
    """

    receive_address: int
    tick_address: int
    config: Memory
    state: Memory
    precision: Precision


@functools.cache
def functions(target: HostName) -> list[Any]:
    """The firmware's C functions of `TYPES`; their first use compiles them or loads them from the cache."""
    return [load_function(object_code(target), name, kind) for name, kind in TYPES.items()]


class NativeNode(FlatNode):
    """One controller in double precision, whose functions work on `memory` itself."""

    target: HostName = "host"

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._receive, self._advance, self._tick = functions(self.target)
        self._precision = TARGETS[self.target].precision
        self._own = to_precision(self.whole, FirmwareState, self._precision)
        self._take, self._give = copier(self._own, self.whole), copier(self.whole, self._own)
        self.push_memory()

    @property
    def native(self) -> Native:
        """The node's function and memory; `push_memory` may replace the memory."""
        receive, tick = (cast(int, ctypes.cast(one, POINTER).value) for one in (self._receive, self._tick))
        return Native(receive, tick, self._own_config, self._own, self._precision)

    def receive_rows(self, count: int, rows: Any) -> None:
        """Put `count` frames into the inbox."""
        self._receive(self._addresses[1], count, rows)

    def advance(self, elapsed_ticks: int) -> int:
        """Let time pass; the number of periods to run."""
        config, state, _ = self._addresses
        periods: int = self._advance(config, state, elapsed_ticks)
        return periods

    def run(self) -> int:
        """One tick."""
        status: int = self._tick(*self._addresses)
        self.pull_state()
        return status

    def push_memory(self) -> None:
        """Hand over config and state in the functions' precision."""
        self._own_config = to_precision(self.flat_config, Config, self._precision)
        self._addresses = [memory.ctypes.data for memory in (self._own_config, self._own, self.tx)]
        self._give()

    def pull_state(self) -> None:
        """Update `memory` after a call of a function."""
        self._take()


class SinglePrecisionNode(NativeNode):
    """One controller in single precision; `memory` holds its numbers as doubles."""

    target = "host-single"
