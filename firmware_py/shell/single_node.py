"""The node in single precision in this process: the object file of `host-single`."""

import ctypes
import functools
from collections.abc import Mapping
from typing import Any, cast

from firmware_py.builds.flat import copier, in_precision
from firmware_py.builds.loaded_object import function
from firmware_py.builds.machine_code import ENTRY, object_code
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.native import Native, NativeNode

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
ARGUMENTS = (POINTER, POINTER, INTEGER, INTEGER, POINTER, POINTER)
TICK = ctypes.CFUNCTYPE(ctypes.c_int32, *ARGUMENTS)


@functools.cache
def vibro_tick() -> Any:
    """The firmware's C function in single precision."""
    return function(object_code("host-single"), ENTRY, TICK)


class SingleNode(NativeNode):
    """One controller; `memory` holds its single-precision numbers as doubles."""

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        super().__init__(config, parameters)
        self._tick = vibro_tick()
        self._own = in_precision(self.whole, FirmwareState, "single")
        self._take, self._give = copier(self._own, self.whole), copier(self.whole, self._own)
        self.push_memory()

    @property
    def native(self) -> Native:
        """The function, and its own memory in single precision."""
        address = cast(int, ctypes.cast(self._tick, POINTER).value)
        return Native(address, 0, self._own_config, self._own, "single")

    def run(self, behind_ticks: int, frame_count: int, frames: Any) -> bool:
        """One tick."""
        config, state, sent = (memory.ctypes.data for memory in (self._own_config, self._own, self.tx))
        status = self._tick(config, state, behind_ticks, frame_count, ctypes.addressof(frames), sent)
        self.pull_state()
        return bool(status == 0)

    def push_memory(self) -> None:
        """Round config and state to single precision."""
        self._own_config = in_precision(self.flat_config, Config, "single")
        self._give()

    def pull_state(self) -> None:
        """Copy the state to `memory`, in double precision."""
        self._take()
