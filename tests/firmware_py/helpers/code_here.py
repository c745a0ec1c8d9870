"""An object file of the firmware in this process, without a linker."""

import ctypes
import functools
from collections.abc import Mapping
from typing import Any

import llvmlite.binding as llvm

from firmware_py.builds.flat import copier, in_precision
from firmware_py.builds.machine_code import ENTRY, object_code
from firmware_py.core.state import Config
from firmware_py.node.tick import NodeState
from firmware_py.shell.flat_node import FlatNode

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
TICK = ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, POINTER, INTEGER, INTEGER, POINTER, POINTER)


def function(code: bytes, name: str, prototype: Any) -> Any:
    """A function of an object file for this machine."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    linker = llvm.create_lljit_compiler(use_jit_link=True)  # keeps code and constants side by side
    library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(name)
    linked = library.link(linker, name)
    found = prototype(linked[name])
    found.linked = linked  # whose end would be the code's
    return found


@functools.cache
def vibro_tick() -> Any:
    """The firmware's function in single precision."""
    return function(object_code("host-single"), ENTRY, TICK)


class SingleNode(FlatNode):
    """One controller in single precision in this process; `memory` holds its numbers as doubles."""

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        super().__init__(config, parameters)
        self._tick = vibro_tick()
        self._own = in_precision(self.memory, NodeState, "single")
        self._take, self._give = copier(self._own, self.memory), copier(self.memory, self._own)
        self.changed()

    def run(self, elapsed_ticks: int, frame_count: int, frames: Any) -> bool:
        addresses = (self._own_config.ctypes.data, self._own.ctypes.data)
        status = self._tick(
            *addresses, elapsed_ticks, frame_count, ctypes.addressof(frames), self.tx.ctypes.data
        )
        self._take()
        return bool(status == 0)

    def changed(self) -> None:
        self._own_config = in_precision(self.flat_config, Config, "single")
        self._give()
