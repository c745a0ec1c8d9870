"""Nodes whose firmware is an object file in this process; compiled code can call it, by address."""

import ctypes
import functools
from typing import Any, NamedTuple, cast

from firmware_py.builds.flat import Memory, Precision, copier, to_precision
from firmware_py.builds.loaded_object import load_function
from firmware_py.builds.machine_code import ENTRY, TARGETS, HostName, object_code
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.flat_node import FlatNode

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
ARGUMENTS = (POINTER, POINTER, INTEGER, INTEGER, POINTER, POINTER)
TICK = ctypes.CFUNCTYPE(ctypes.c_int32, *ARGUMENTS)


class Native(NamedTuple):
    """The address of a C function in this process, and the memory on which it works.

    The function returns 0 unless its arithmetic has failed.
    """

    tick_address: int
    config: Memory
    state: Memory
    precision: Precision


@functools.cache
def vibro_tick(target: HostName) -> Any:
    """The firmware's C function; its first use compiles it or loads it from the cache."""
    return load_function(object_code(target), ENTRY, TICK)


class NativeNode(FlatNode):
    """One controller in double precision, whose function works on `memory` itself."""

    target: HostName = "host"

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._tick = vibro_tick(self.target)
        self._precision = TARGETS[self.target].precision
        self._own = to_precision(self.whole, FirmwareState, self._precision)
        self._take, self._give = copier(self._own, self.whole), copier(self.whole, self._own)
        self.push_memory()

    @property
    def native(self) -> Native:
        """The node's function and memory; `push_memory` may replace the memory."""
        address = cast(int, ctypes.cast(self._tick, POINTER).value)
        return Native(address, self._own_config, self._own, self._precision)

    def run(self, behind_ticks: int, frame_count: int, frames: Any) -> int:
        """One tick."""
        config, state, sent = self._addresses
        status: int = self._tick(config, state, behind_ticks, frame_count, frames, sent)
        self.pull_state()
        return status

    def push_memory(self) -> None:
        """Hand over config and state in the function's precision."""
        self._own_config = to_precision(self.flat_config, Config, self._precision)
        self._addresses = [memory.ctypes.data for memory in (self._own_config, self._own, self.tx)]
        self._give()

    def pull_state(self) -> None:
        """Update `memory` after a call of the function."""
        self._take()


class SinglePrecisionNode(NativeNode):
    """One controller in single precision; `memory` holds its numbers as doubles."""

    target = "host-single"
