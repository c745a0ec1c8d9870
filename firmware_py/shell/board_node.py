"""The node on an emulated board: a Cortex-M in QEMU that is powered up when the node is made."""

import os
import struct
import subprocess
import weakref
from typing import Any, BinaryIO, cast

import numpy as np

from firmware_py.builds import board
from firmware_py.builds.c_compiler import TARGETS
from firmware_py.builds.flat import Memory, Precision, copier, from_flat, layout, to_precision
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import Tx
from firmware_py.node.xcp import NO_REQUEST, REQUEST
from firmware_py.shell.flat_node import FRAME_BYTES, FlatNode

TICK, CONFIG, STATE, MEASURED_TICK, READ_CONFIG, RECEIVE, ADVANCE = range(7)
MESSAGE, PERIODS = struct.Struct("<2q"), struct.Struct("<q")


def reply_layout(precision: Precision) -> "np.dtype[np.void]":
    """The layout of the board's reply to a tick."""
    numbers = ((name, np.int64) for name in ("timer_ticks", "stack_bytes"))
    return np.dtype([*numbers, ("tx", layout(Tx, precision)), ("state", layout(FirmwareState, precision))])


class BoardDiedError(RuntimeError):
    """The emulator has ended unexpectedly."""


class BoardNode(FlatNode):
    """One controller on its own Cortex-M7; after each tick `memory` is a copy of the board's state."""

    target: board.BoardName = "cortex-m7"
    kind = TICK

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._precision = TARGETS[self.target].precision
        board_process = board.start(self.target)
        weakref.finalize(self, _switch_off, board_process, os.getpid())
        self._process = board_process
        self._to_board = cast(BinaryIO, board_process.stdin)
        self._from_board = cast(BinaryIO, board_process.stdout)
        self.reply = np.zeros(1, reply_layout(self._precision))
        self._take_state = copier(self.reply["state"], self.whole)
        self._reply_bytes = memoryview(self.reply.view("u1"))  # type: ignore[arg-type]  # no buffer in stubs
        self._send(CONFIG, Config, self.flat_config)

    def receive_rows(self, count: int, rows: Any) -> None:
        """Send `count` frames to the board's inbox."""
        self._write(MESSAGE.pack(RECEIVE, count) + bytes(memoryview(rows)[: FRAME_BYTES * count]))

    def advance(self, elapsed_ticks: int) -> int:
        """Let the board's time pass; the number of periods to run."""
        periods = bytearray(PERIODS.size)
        self._write(MESSAGE.pack(ADVANCE, elapsed_ticks))
        self._read(memoryview(periods))
        return int(PERIODS.unpack(periods)[0])

    def run(self) -> None:
        """One tick, before which the board processes a write over XCP."""
        is_asked = self.pool[REQUEST] != NO_REQUEST
        self._write(MESSAGE.pack(self.kind, 0))
        self._read(self._reply_bytes)
        if is_asked:
            self._read_config()
        self.tx[:] = self.reply["tx"]
        self._take_state()

    def calibrate(self) -> bool:
        """Nothing to do: the board processes the request by itself."""
        return False

    def _read_config(self) -> None:
        """Take the board's config and parameters."""
        own = np.zeros(1, layout(Config, self._precision))
        self._write(MESSAGE.pack(READ_CONFIG, 0))
        self._read(memoryview(own.view("u1")))  # type: ignore[arg-type]  # no buffer in stubs
        copier(own, self.flat_config)()
        self.config = from_flat(Config, self.flat_config[0].item())

    def _read(self, reply: memoryview) -> None:
        """Fill a buffer with the board's reply."""
        if self._from_board.readinto(reply) != reply.nbytes:  # type: ignore[attr-defined]
            raise BoardDiedError(f"the emulated board has ended, status {self._process.wait()}")

    def push_memory(self) -> None:
        """Send config and state to the board."""
        self._send(CONFIG, Config, self.flat_config)
        self._send(STATE, FirmwareState, self.whole)

    def _send(self, kind: int, record: type[Any], content: Memory) -> None:
        self._write(MESSAGE.pack(kind, 0) + to_precision(content, record, self._precision).tobytes())

    def _write(self, message: bytes) -> None:
        try:
            self._to_board.write(message)
            self._to_board.flush()
        except BrokenPipeError:
            raise BoardDiedError(f"the emulated board has ended, status {self._process.wait()}") from None


class SinglePrecisionBoardNode(BoardNode):
    """One controller on a Cortex-M4F; `memory` holds its single-precision numbers as doubles."""

    target = "cortex-m4f"


def _switch_off(process: "subprocess.Popen[bytes]", owner: int) -> None:
    """End the emulator by closing its input; a forked process leaves that of its parent on."""
    if os.getpid() == owner:
        process.communicate()
