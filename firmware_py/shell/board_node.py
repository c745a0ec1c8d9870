"""The same node on an emulated board: a Cortex-M7 in QEMU that was switched on when the node was made."""

import struct
import subprocess
import weakref
from collections.abc import Mapping
from typing import Any, BinaryIO, cast

import numpy as np

from firmware_py.builds import board
from firmware_py.builds.flat import Memory, layout
from firmware_py.core.step import Config
from firmware_py.node.tick import NodeState, Tx
from firmware_py.shell.flat_node import FRAME_BYTES, FlatNode

TICK, CONFIG, STATE, MEASURED_TICK = range(4)
REQUEST = struct.Struct("<3q")
REPLY = np.dtype(
    [
        *((name, np.int64) for name in ("status", "timer_ticks", "stack_bytes")),
        ("tx", layout(Tx)),
        ("state", layout(NodeState)),
    ]
)


class BoardDiedError(RuntimeError):
    """The emulator has ended."""


class BoardNode(FlatNode):
    """One controller on a board of its own; `memory` is a copy of the board's after each tick."""

    kind = TICK

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        super().__init__(config, parameters)
        board_process = board.start()
        weakref.finalize(self, _switch_off, board_process)
        self._process = board_process
        self._to_board = cast(BinaryIO, board_process.stdin)
        self._from_board = cast(BinaryIO, board_process.stdout)
        self.reply = np.zeros(1, REPLY)
        self._reply_bytes = memoryview(self.reply.view("u1"))  # type: ignore[arg-type]  # no buffer in stubs
        self._send(CONFIG, self.flat_config)

    def run(self, elapsed_ticks: int, frame_count: int, frames: Any) -> bool:
        """One tick."""
        request = REQUEST.pack(self.kind, elapsed_ticks, frame_count)
        self._write(request + bytes(memoryview(frames)[: FRAME_BYTES * frame_count]))
        if self._from_board.readinto(self._reply_bytes) != REPLY.itemsize:  # type: ignore[attr-defined]
            raise BoardDiedError(f"the emulated board has ended, status {self._process.wait()}")
        self.tx[:], self.memory[:] = self.reply["tx"], self.reply["state"]
        return bool(self.reply["status"][0] == 0)

    def changed(self) -> None:
        """Hand both to the board."""
        self._send(CONFIG, self.flat_config)
        self._send(STATE, self.memory)

    def _send(self, kind: int, content: Memory) -> None:
        self._write(REQUEST.pack(kind, 0, 0) + content.tobytes())

    def _write(self, message: bytes) -> None:
        try:
            self._to_board.write(message)
            self._to_board.flush()
        except BrokenPipeError:
            raise BoardDiedError(f"the emulated board has ended, status {self._process.wait()}") from None


def _switch_off(process: "subprocess.Popen[bytes]") -> None:
    """The end of its input ends the emulator."""
    process.communicate()
