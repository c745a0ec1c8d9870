"""The node of the `compiled` build: numba's code behind one C function."""

from collections.abc import Mapping
from typing import Any

from firmware_py.builds.entry import entry
from firmware_py.core.config import Config
from firmware_py.shell.native import Native, NativeNode


class CompiledNode(NativeNode):
    """One controller in this process."""

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        super().__init__(config, parameters)
        self._addresses = (self.flat_config.ctypes.data, self.memory.ctypes.data, self.tx.ctypes.data)
        self._entry: Any = entry.ctypes

    @property
    def native(self) -> Native:
        """Numba's function, on the node's own memory."""
        return Native(entry.address, 1, self.flat_config, self.memory, "double")

    def run(self, behind_ticks: int, frame_count: int, frames: Any) -> bool:
        """One tick."""
        config, state, sent = self._addresses
        return bool(self._entry(config, state, behind_ticks, frame_count, frames, sent))

    def push_memory(self) -> None:
        """Nothing to do: the tick reads config and state from this memory."""

    def pull_state(self) -> None:
        """Nothing to do: the tick writes to `memory`."""
