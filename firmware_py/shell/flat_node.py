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
from firmware_py.node.tick import MAX_RX, NO_TX
from firmware_py.shell.node import Node

FRAME_BYTES = 24
_TX = struct.Struct("<10q")
_RX = [struct.Struct(f"<{3 * count}q") for count in range(MAX_RX + 1)]


class FirmwareFailedError(ArithmeticError):
    """The arithmetic of a tick failed, e.g. by a division by zero."""


class FlatNode(Node):
    """A node in flat memory; a subclass runs its tick, in this process or on a board.

    These are two subclasses, not two transports of one class, because a board keeps its memory to itself and
    processes the writes over XCP by itself.

    `whole` holds the `FirmwareState`, one element laid out by `firmware_py.builds.flat.layout`; `memory` is
    its first member, the `NodeState`, at the same address, and `pool` its last one.
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

    @abstractmethod
    def run(self, behind_ticks: int, frame_count: int, frames: Any) -> int:
        """Run one tick on `memory` and write its frames to `tx`; return 0 unless the arithmetic failed."""

    @abstractmethod
    def push_memory(self) -> None:
        """Hand over `flat_config` and `whole` after a change; a tick uses them from then on."""

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = from_flat(kind, self.memory[name][0].item())
        return record

    def run_period(self, frames: Sequence[Frame], behind_ticks: int) -> list[Frame]:
        """Run one control period, `behind_ticks` before the present one."""
        words: list[int] = []
        for can_id, data in frames:
            words += (can_id, len(data), word_of(data))
        count = len(words) // 3
        _RX[count].pack_into(self._rx, 0, *words)
        if self.run(behind_ticks, count, self._rx) != 0:
            raise FirmwareFailedError("a division by zero or a domain error in the firmware's tick")
        frame_count, *words = _TX.unpack_from(self._sent)
        return [
            Frame(words[place], bytes_of(words[place + 2], words[place + 1]))
            for place in range(0, 3 * frame_count, 3)
        ]

    def calibrate(self) -> bool:
        """Judge the waiting request of XCP; interpreted, because requests are rare."""
        is_judged = super().calibrate()
        if is_judged:
            self.flat_config[:] = to_flat(self.config)
            self.push_memory()
        return is_judged
