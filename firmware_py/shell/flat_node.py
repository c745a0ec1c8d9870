"""A node whose firmware is one C function: config, state and frames are in flat memory."""

import ctypes
import struct
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, cast

from firmware_py.builds.flat import Memory, from_flat, to_flat
from firmware_py.core.config import Config
from firmware_py.interface.frame import Frame, bytes_of, word_of
from firmware_py.interface.zeroed import Record
from firmware_py.node.memory import INITIAL, pool_of
from firmware_py.node.tick import NO_TX
from firmware_py.shell.node import Node

FRAME_BYTES = 24
_TX = struct.Struct("<10q")
MOST_AT_ONCE = 64
"""Most frames that are handed over in one call."""
_RX = [struct.Struct(f"<{3 * count}q") for count in range(MOST_AT_ONCE + 1)]


class FlatNode(Node):
    """A node in flat memory; a subclass runs its tick, in this process or on a board.

    These are two subclasses, not two transports of one class, because a board keeps its memory to itself and
    processes the writes over XCP by itself.

    `whole` holds the `FirmwareState`, one element laid out by `firmware_py.builds.flat.layout`; `memory` is
    its first member, the `NodeState`, at the same address; `pool` and `inbox` are the other two.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.whole: Memory = to_flat(INITIAL._replace(pool=tuple(pool_of(self.values.values()))))
        self.memory: Memory = self.whole["node"]
        self.pool = cast("list[int]", self.whole["pool"][0])  # an array, used like a list
        self.flat_config = to_flat(config)
        self.tx = to_flat(NO_TX)
        self._sent = memoryview(self.tx.view("u1"))  # type: ignore[arg-type]  # numpy's stubs lack the buffer
        self._rx = ctypes.create_string_buffer(_RX[-1].size)

    @property
    def ticks(self) -> int:
        """The number of periods since power-up."""
        return int(self.memory["ticks"][0])

    @property
    def inbox(self) -> list[int]:
        """The memory of the waiting frames, as of the last tick."""
        return cast("list[int]", self.whole["inbox"][0])

    @abstractmethod
    def receive_rows(self, count: int, rows: Any) -> None:
        """Put `count` frames into the inbox; `rows`: their identifiers, lengths and words."""

    @abstractmethod
    def run(self) -> None:
        """Run one tick on `memory` and write its frames to `tx`."""

    @abstractmethod
    def push_memory(self) -> None:
        """Hand over `flat_config` and `whole` after a change; a tick uses them from then on."""

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = from_flat(kind, self.memory[name][0].item())
        return record

    def receive(self, frames: Sequence[Frame]) -> None:
        """Put frames into the inbox in the order of their arrival."""
        for first in range(0, len(frames), MOST_AT_ONCE):
            words: list[int] = []
            for can_id, data in frames[first : first + MOST_AT_ONCE]:
                words += (can_id, len(data), word_of(data))
            count = len(words) // 3
            _RX[count].pack_into(self._rx, 0, *words)
            self.receive_rows(count, self._rx)

    def run_period(self) -> list[Frame]:
        """Run one control period."""
        self.run()
        frame_count, *words = _TX.unpack_from(self._sent)
        return [
            Frame(words[index], bytes_of(words[index + 2], words[index + 1]))
            for index in range(0, 3 * frame_count, 3)
        ]

    def calibrate(self) -> bool:
        """Judge the waiting request of XCP; interpreted, because requests are rare."""
        is_judged = super().calibrate()
        if is_judged:
            self.flat_config[:] = to_flat(self.config)
            self.push_memory()
        return is_judged
