"""Nodes whose firmware is machine code in this process; compiled code can call it, by address."""

import ctypes
import functools
from typing import Any, NamedTuple, cast

from firmware_py.builds.flat import Memory, Precision, copier, to_precision
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.flat_node import FlatNode

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
TYPES = {
    "vibro_receive": ctypes.CFUNCTYPE(None, POINTER, INTEGER, POINTER),
    "vibro_advance": ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, POINTER, INTEGER),
    "vibro_tick": ctypes.CFUNCTYPE(None, POINTER, POINTER, POINTER),
}


class Native(NamedTuple):
    """The addresses of the functions of `TYPES` in this process, and the memory they work on."""

    receive_address: int
    advance_address: int
    tick_address: int
    config: Memory
    state: Memory
    precision: Precision


@functools.cache
def compiled_functions() -> list[Any]:
    """The functions of `TYPES`, compiled by numba; their first use compiles them or loads them."""
    from firmware_py.builds.compiled import kernels  # noqa: PLC0415 - imports numba

    return [kind(kernels()[name].address) for name, kind in TYPES.items()]


@functools.cache
def emitted_functions(precision: Precision) -> list[Any]:
    """The functions of `TYPES` of the emitted C; raise CompilerError without a compiler."""
    from firmware_py.builds.c_compiler import shared_library  # noqa: PLC0415 - imports the emitter

    library = ctypes.CDLL(str(shared_library("host" if precision == "double" else "host-single")))
    return [kind((name, library)) for name, kind in TYPES.items()]


class NativeNode(FlatNode):
    """One controller in double precision, whose functions work on `memory` itself."""

    precision: Precision = "double"

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._receive, self._advance, self._tick = self.load_functions()
        self._own = to_precision(self.whole, FirmwareState, self.precision)
        self._take, self._give = copier(self._own, self.whole), copier(self.whole, self._own)
        self.push_memory()

    @staticmethod
    def load_functions() -> list[Any]:
        """The functions of `TYPES`."""
        return compiled_functions()

    @property
    def native(self) -> Native:
        """The node's function and memory; `push_memory` may replace the memory."""
        functions = self._receive, self._advance, self._tick
        receive, advance, tick = (cast(int, ctypes.cast(one, POINTER).value) for one in functions)
        return Native(receive, advance, tick, self._own_config, self._own, self.precision)

    def receive_rows(self, count: int, rows: Any) -> None:
        """Put `count` frames into the inbox."""
        self._receive(self._addresses[1], count, rows)

    def advance(self, elapsed_ticks: int) -> int:
        """Let time pass; the number of periods to run."""
        config, state, _ = self._addresses
        periods: int = self._advance(config, state, elapsed_ticks)
        return periods

    def run(self) -> None:
        """One tick."""
        self._tick(*self._addresses)
        self.pull_state()

    def push_memory(self) -> None:
        """Hand over config and state in the functions' precision."""
        self._own_config = to_precision(self.flat_config, Config, self.precision)
        self._addresses = [memory.ctypes.data for memory in (self._own_config, self._own, self.tx)]
        self._give()

    def pull_state(self) -> None:
        """Update `memory` after a call of a function."""
        self._take()


class SinglePrecisionNode(NativeNode):
    """One controller in single precision, from the emitted C; `memory` holds its numbers as doubles."""

    precision = "single"

    @staticmethod
    def load_functions() -> list[Any]:
        """The functions of `TYPES`."""
        return emitted_functions("single")
