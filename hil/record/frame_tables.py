"""The frames of can.log as columns of signals by `vibro.dbc`, as tables, and those that cannot be decoded.

Frames are decoded column by column. A frame that this refuses is left to its codec, which says why.
"""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from firmware_py.interface.codec import CODEC_BY_ID, FrameCodec
from firmware_py.interface.dbc import Signal, SignalKind, database, signal_of
from firmware_py.interface.framing import CRC_FINAL_XOR, CRC_TABLE
from hil.record.candump import MOST_BYTES, Bus, BusLog
from hil.record.traces.precision import whole_ns
from plant_sim.arrays import BoolArray, IntArray

RAW: Final = "can/raw"
"""Name of the table with a row per frame: its identifier and its bytes."""
CRC_STEPS = np.frombuffer(CRC_TABLE, np.uint8)


# --- columns ---------------------------------------------------------------------------------------------


class FrameWords(NamedTuple):
    """Frames of one identifier: their rows in the log of the bus, and their bytes as 64-bit words."""

    rows: IntArray
    words: NDArray[np.uint64]


def valid_frames(bus: BusLog, codec: FrameCodec[Any]) -> FrameWords:
    """The frames of one identifier that can be decoded."""
    rows = np.flatnonzero((bus.can_id == codec.can_id) & (bus.length == codec.length))
    data = np.zeros((len(rows), MOST_BYTES), np.uint8)
    content, starts = np.frombuffer(bus.content, np.uint8), bus.starts[rows]
    for place in range(codec.length):  # by column: places of all bytes would take eight times the memory
        data[:, place] = content[starts + place]
    valid = is_surely_valid(codec, data)
    return FrameWords(rows[valid], words_of(data[valid]))


def words_of(data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """The bytes of frames, shape (n, 8), as words."""
    return np.ascontiguousarray(data).view("<u8")[:, 0]


def counts_of(signal: Signal, words: NDArray[np.uint64]) -> NDArray[Any]:
    """A signal's counts in each frame; those of a float are its value."""
    if signal.is_float:
        return (words >> np.uint64(signal.start)).astype(np.uint32).view(np.float32)
    above = 64 - signal.start - signal.bits
    kind = np.int64 if signal.is_signed else np.uint64
    return (words << np.uint64(above)).view(kind) >> kind(64 - signal.bits)


def values_of(signal: Signal, words: NDArray[np.uint64]) -> NDArray[Any]:
    """A signal's value in each frame: a float, or a whole number."""
    counts = counts_of(signal, words)
    return counts * float(signal.scale) if signal.is_real else counts.astype(np.int64)


def is_surely_valid(codec: FrameCodec[Any], data: NDArray[np.uint8]) -> BoolArray:
    """Mask of the frames of the right length, shape (n, 8), that the codec decodes without error."""
    valid = np.ones(len(data), bool)
    if codec.protected:
        check = np.full(len(data), codec.kind.register, np.uint8)
        for byte in data[:, : codec.length - 1].T:
            check = CRC_STEPS[check ^ byte]
        valid &= (check ^ CRC_FINAL_XOR) == data[:, codec.length - 1]
    words = words_of(data)
    for signal in codec.signals.values():
        counts = counts_of(signal, words)
        if signal.is_float:
            valid &= np.isfinite(counts)
        elif signal.kind is SignalKind.ENUMERATION:
            valid &= np.isin(counts, list(signal.values))
        elif signal.kind is not SignalKind.FLAGS:
            valid &= (counts >= signal.low_counts) & (counts <= signal.high_counts)
    return valid


# --- tables ----------------------------------------------------------------------------------------------


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
    frames = valid_frames(bus, codec)
    columns = {signal.name: values_of(signal, frames.words) for signal in codec.signals.values()}
    message = database().get_message_by_frame_id(codec.can_id)
    for signal in (signal_of(message, one) for one in message.signals):
        if signal.name not in columns:  # the counter and the CRC, which are no signals of the codec's record
            columns[signal.name] = counts_of(signal, frames.words)
    return pa.table({**times_of(bus, frames.rows, wall_start_s), **columns})


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


# --- frames that cannot be decoded -----------------------------------------------------------------------


def find_refused(bus: BusLog) -> list[tuple[int, str]]:
    """Index and reason of each frame that cannot be decoded, in order of time."""
    return sorted(
        reason for can_id in np.unique(bus.can_id).tolist() for reason in find_refused_of(bus, can_id)
    )


def find_refused_of(bus: BusLog, can_id: int) -> Iterator[tuple[int, str]]:
    """Yield index and reason of each refused frame of one identifier."""
    codec = CODEC_BY_ID.get(can_id)
    rows = np.flatnonzero(bus.can_id == can_id)
    if codec is None:
        yield from ((row, f"0x{can_id:03X}: not in the DBC") for row in rows.tolist())
        return
    is_valid = np.zeros(len(bus.can_id), bool)
    is_valid[valid_frames(bus, codec).rows] = True
    doubtful = rows[~is_valid[rows]]
    for row, payload in zip(doubtful.tolist(), bus.payloads_of(doubtful), strict=True):
        try:
            codec.decode(payload)
        except ValueError as error:
            yield row, f"0x{codec.can_id:03X}: {error}"
