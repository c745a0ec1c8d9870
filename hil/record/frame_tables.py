"""The frames of can.log as tables, raw and decoded by `vibro.dbc`, and the frames that cannot be decoded."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from firmware_py.interface.codec import CODEC_BY_ID, FrameCodec
from firmware_py.interface.dbc import SignalKind, database
from firmware_py.interface.framing import CRC_FINAL_XOR, CRC_TABLE
from hil.record.candump import MOST_BYTES, Bus, BusLog
from hil.record.traces.precision import whole_ns
from plant_sim.arrays import BoolArray, IntArray

RAW: Final = "can/raw"
"""Name of the table with a row per frame: its identifier and its bytes."""
CRC_STEPS = np.frombuffer(CRC_TABLE, np.uint8)
SLICE_ROWS = 10_000
"""Frames that are decoded at a time: Python's objects take ten times the memory of their columns."""


def names_of(bus: Bus) -> list[str]:
    """The names of a bus's tables: `can/raw`, and one for each frame of `vibro.dbc` that has signals."""
    found: set[int] = set()
    for piece in bus.pieces():
        found.update(np.unique(piece.can_id).tolist())
    codecs = [codec for can_id, codec in CODEC_BY_ID.items() if can_id in found and codec.record._fields]
    return [RAW, *sorted(f"can/{codec.record.__name__}" for codec in codecs)] if found else []


def table_of(bus: BusLog, name: str, wall_start_s: float) -> pa.Table:
    """One of the tables of `names_of`, with a row per frame and a column per signal.

    A frame's table has all signals of `vibro.dbc`, counter and CRC too; frames that cannot be decoded are
    left out. `wall_start_s`: the run's start on the wall clock.
    """
    if name == RAW:
        return raw_table(bus, wall_start_s)
    (codec,) = (one for one in CODEC_BY_ID.values() if f"can/{one.record.__name__}" == name)
    rows = np.flatnonzero(bus.can_id == codec.can_id)
    parts = [
        decoded_slice(bus, rows[first : first + SLICE_ROWS], codec)
        for first in range(0, len(rows), SLICE_ROWS)
    ]
    parts = [part for part in parts if len(part[0])] or parts[:1]
    good = np.concatenate([rows for rows, _ in parts])
    columns = {name: np.concatenate([part[name] for _, part in parts]) for name in parts[0][1]}
    return pa.table({**times_of(bus, good, wall_start_s), **columns})


def times_of(bus: BusLog, rows: IntArray, wall_start_s: float) -> dict[str, NDArray[Any]]:
    """Simulated seconds and wall clock of some frames, the first two columns of each table."""
    t_s = bus.t_s[rows]
    wall_ns = round(wall_start_s * 1e9) + whole_ns(t_s)
    return {"t_s": t_s, "wall_time": wall_ns.astype("datetime64[ns]")}


def raw_table(bus: BusLog, wall_start_s: float) -> pa.Table:
    """All frames, with identifier and bytes."""
    offsets = np.append(bus.starts, len(bus.content)).astype(np.int32)
    buffers = [None, pa.py_buffer(offsets), pa.py_buffer(bus.content)]
    data = pa.Array.from_buffers(pa.binary(), len(bus.t_s), buffers)
    times = times_of(bus, np.arange(len(bus.t_s)), wall_start_s)
    return pa.table({**times, "can_id": bus.can_id.astype(np.uint32), "data": data})


def decoded_slice(
    bus: BusLog, rows: IntArray, codec: FrameCodec[Any]
) -> tuple[IntArray, dict[str, NDArray[Any]]]:
    """The rows of the frames that can be decoded, and their signals."""
    good, records, words = [], [], []
    for row, payload in zip(rows.tolist(), bus.payloads_of(rows), strict=True):
        try:
            records.append(tuple(codec.decode(payload)))
        except ValueError:
            continue  # listed in the log
        good.append(row)
        words.append(int.from_bytes(payload, "little"))
    values = zip(*records, strict=True) if records else [()] * len(codec.record._fields)
    columns = dict(zip(codec.record._fields, map(np.array, values), strict=True))
    word = np.array(words, np.uint64)
    for signal in database().get_message_by_frame_id(codec.can_id).signals:
        if signal.name not in columns:  # the counter and the CRC, which are no signals of the codec's record
            columns[signal.name] = word >> np.uint64(signal.start) & np.uint64((1 << signal.length) - 1)
    return np.array(good, np.int64), columns


# --- frames that cannot be decoded -----------------------------------------------------------------------


def refused(bus: BusLog) -> list[tuple[int, str]]:
    """Index and reason of each frame that cannot be decoded, in order of time."""
    found: list[tuple[int, str]] = []
    for can_id in np.unique(bus.can_id).tolist():
        codec = CODEC_BY_ID.get(can_id)
        rows = np.flatnonzero(bus.can_id == can_id)
        if codec is None:
            found += [(row, f"0x{can_id:03X}: not in the DBC") for row in rows.tolist()]
        else:
            found += refused_rows(bus, codec, rows)
    return sorted(found)


def surely_valid(codec: FrameCodec[Any], data: NDArray[np.uint8]) -> BoolArray:
    """Mask of the frames, shape (n, 8), that certainly decode without error; others need their codec."""
    valid = np.ones(len(data), bool)
    if codec.protected:
        check = np.full(len(data), codec.kind.register, np.uint8)
        for byte in data[:, : codec.length - 1].T:
            check = CRC_STEPS[check ^ byte]
        valid &= (check ^ CRC_FINAL_XOR) == data[:, codec.length - 1]
    words = np.ascontiguousarray(data).view("<u8")[:, 0]
    for signal in codec.signals.values():
        if signal.is_float:
            bits = (words >> np.uint64(signal.start)).astype(np.uint32)
            valid &= np.isfinite(bits.view(np.float32))
        elif signal.kind in (SignalKind.QUANTITY, SignalKind.EXACT):
            above = 64 - signal.start - signal.bits
            kind = np.int64 if signal.is_signed else np.uint64
            counts = (words << np.uint64(above)).view(kind) >> kind(64 - signal.bits)
            valid &= (counts >= signal.low_counts) & (counts <= signal.high_counts)
        else:
            valid[:] = False
    return valid


def refused_rows(bus: BusLog, codec: FrameCodec[Any], rows: IntArray) -> Iterator[tuple[int, str]]:
    """Yield index and reason of each refused frame of one identifier."""
    whole = bus.length[rows] == codec.length
    starts = bus.starts[rows[whole]]
    data = np.zeros((len(starts), MOST_BYTES), np.uint8)
    content = np.frombuffer(bus.content, np.uint8)
    data[:, : codec.length] = content[starts[:, None] + np.arange(codec.length)]
    doubtful = ~whole
    doubtful[whole] = ~surely_valid(codec, data)
    for row, payload in zip(rows[doubtful].tolist(), bus.payloads_of(rows[doubtful]), strict=True):
        try:
            codec.decode(payload)
        except ValueError as error:
            yield row, f"0x{codec.can_id:03X}: {error}"
