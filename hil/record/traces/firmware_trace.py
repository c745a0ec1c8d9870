"""The firmware's record of a tick for its trace; a compiled build's memory is copied as it is."""

import struct
from collections.abc import Sequence
from functools import cache
from operator import attrgetter
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.flat import Precision, layout
from firmware_py.core.inputs import Inputs
from firmware_py.core.state import Outputs, State
from firmware_py.interface.arrivals import Counters
from firmware_py.node.tick import NodeState
from firmware_py.shell.node import Node
from hil.record.traces.trace import FieldType, OpenTrace, RecordWriter
from hil.timing.loop import LoopTiming

OF_A_WALK = ("gait", "gait_lock")
"""Parts of the firmware's state that are recorded only in runs with a gait."""
MEMORY_OF = {"inputs": "inputs", "state": "core", "outputs": "outputs", "counters": "counters"}
"""Member of the firmware's memory for each prefix of the trace's columns."""
HEAD, TAIL = struct.Struct("<qd"), struct.Struct("<qddqd")
"""A record's tick and time, and its `LoopTiming`; the firmware's signals lie between them."""


def place_in(memory: Any, path: Sequence[str]) -> int:
    """Offset of a member of a structured type, in bytes."""
    place = 0
    for name in path:
        memory, offset = memory.fields[name][:2]
        place += offset
    return place


def columns_of(names: Sequence[str]) -> Any:
    """A packed record type of members of the firmware's memory, such as outputs.mode, for `moves_to`."""
    kinds = []
    for name in names:
        first, *path = name.split(".")
        kind = layout(NodeState)
        for member in (MEMORY_OF[first], *path):
            kind = kind.fields[member][0]
        kinds.append((name, kind))
    return np.dtype(kinds)


def columns_in(columns: Any, precision: Precision) -> Any:
    """The same packed record type, with the firmware's members in this precision."""
    if precision == "double":
        return columns
    kinds = [(name, columns.fields[name][0]) for name in columns.names]
    return np.dtype(
        [(name, np.float32 if "." in name and kind == np.float64 else kind) for name, kind in kinds]
    )


@cache
def moves_to(columns: Any, precision: Precision = "double") -> NDArray[np.int64]:
    """Copies of bytes from the firmware's memory to a packed record: rows of source, destination, length."""
    memory = layout(NodeState, precision)
    moves: list[list[int]] = []
    for name in columns.names:
        first, *path = name.split(".")
        if path:
            kind, destination = columns.fields[name][:2]
            source = place_in(memory, [MEMORY_OF[first], *path])
            if moves and moves[-1][0] + moves[-1][2] == source and moves[-1][1] + moves[-1][2] == destination:
                moves[-1][2] += kind.itemsize
            else:
                moves.append([source, destination, kind.itemsize])
    return np.array(moves, dtype=np.int64)


def blocks_of(walks: bool) -> list[str]:
    """Names of the recorded parts of the firmware's state."""
    return [name for name in State._fields if walks or name not in OF_A_WALK]


def fields_of(walks: bool) -> list[tuple[str, FieldType]]:
    """The columns of a record, for `TraceWriter`."""
    kinds = get_type_hints(State)
    return [
        ("tick", int),
        ("t_s", float),
        ("inputs", Inputs),
        *((f"state.{name}", kinds[name]) for name in blocks_of(walks)),
        ("outputs", Outputs),
        ("counters", Counters),
        ("", LoopTiming),
    ]


class FirmwareTrace:
    """The firmware's trace; in a run without a gait it omits the signals that concern one."""

    def __init__(self, writer: RecordWriter, walks: bool) -> None:
        """`writer`: of records of `fields_of(walks)`, or of some of their columns."""
        self._blocks_of = attrgetter(*blocks_of(walks))
        self.writer = writer
        self._moves = moves_to(writer.dtype).tolist()
        self._is_timed = "work_us" in (writer.dtype.names or ())
        self._node: Node | None = None
        self._parts: list[memoryview] = []

    def append(self, node: Node, tick: int, t_s: float, timing: LoopTiming) -> None:
        """Record a tick of `node`."""
        if node.memory is None:
            blocks = self._blocks_of(node.state)
            self.writer.append(tick, t_s, node.inputs, *blocks, node.outputs, node.counters, timing)
            return
        if node is not self._node:
            self._node, memory = node, memoryview(node.memory.view("u1"))  # type: ignore[arg-type]  # no buffer in numpy's stubs
            self._parts = [memory[start : start + length] for start, _, length in self._moves]
        tail = TAIL.pack(*timing) if self._is_timed else b""
        self.writer.append_bytes(memoryview(b"".join((HEAD.pack(tick, t_s), *self._parts, tail))))


def open_firmware_trace(traces: OpenTrace, walks: bool) -> FirmwareTrace | None:
    """The trace of the firmware's signals; None if it is not kept."""
    writer = traces("firmware", fields_of(walks), is_ticked=True)
    return None if writer is None else FirmwareTrace(writer, walks)
