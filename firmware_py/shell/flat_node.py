"""A node whose firmware is one C function: config, state and frames are in flat memory."""

import ctypes
import struct
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from firmware_py.builds.flat import Memory, loaded, stored
from firmware_py.core.records import Record
from firmware_py.core.state import Config
from firmware_py.interface.frame import Frame, bytes_of, word_of
from firmware_py.node.tick import INITIAL, MAX_RX, NO_TX, NodeState, served
from firmware_py.shell.node import Node, fitting, refuse_other_elapsed

FRAME_BYTES = 24
_TX = struct.Struct("<7q")
_RX = [struct.Struct(f"<{3 * count}q") for count in range(MAX_RX + 1)]


class FirmwareFailedError(ArithmeticError):
    """The arithmetic of a tick failed, e.g. by a division by zero."""


class FlatNode(Node):
    """A node in flat memory; a subclass runs its tick.

    `memory` holds the whole `NodeState`, one element laid out by `firmware_py.builds.flat.layout`.
    """

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        super().__init__(config, parameters)
        self.memory: Memory = stored(INITIAL)
        self.flat_config = stored(config)
        self.tx = stored(NO_TX)
        self._sent = memoryview(self.tx.view("u1"))  # type: ignore[arg-type]  # numpy's stubs lack the buffer
        self._rx = ctypes.create_string_buffer(_RX[-1].size)
        self._requests = self.memory["requests"]["number"]

    @abstractmethod
    def run(self, elapsed_ticks: int, frame_count: int, frames: Any) -> bool:
        """Run one tick on `memory` and write its frames to `tx`; False if the arithmetic failed."""

    @abstractmethod
    def changed(self) -> None:
        """Called after `flat_config` and `memory` have been changed."""

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = loaded(kind, self.memory[name][0].item())
        return record

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick on the `fitting` frames; `elapsed_ticks` exceeds 1 after skipped ticks."""
        refuse_other_elapsed(elapsed_ticks)
        if self._requests[0] > 0:
            self._serve()
        words: list[int] = []
        for can_id, data in fitting(frames_in):
            words += (can_id, len(data), word_of(data))
        count = len(words) // 3
        _RX[count].pack_into(self._rx, 0, *words)
        if not self.run(elapsed_ticks, count, self._rx):
            raise FirmwareFailedError("a division by zero or a domain error in the firmware's tick")
        frame_count, *words = _TX.unpack_from(self._sent)
        return [
            Frame(words[place], bytes_of(words[place + 2], words[place + 1]))
            for place in range(0, 3 * frame_count, 3)
        ]

    def _serve(self) -> None:
        """Answer parameter requests; interpreted, because requests are rare."""
        state = loaded(NodeState, self.memory[0].item())
        self.parameters, self.config, state = served(self.parameters, self.config, state)
        self.memory[:], self.flat_config[:] = stored(state), stored(self.config)
        self.changed()
