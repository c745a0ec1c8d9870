"""The format of frames in the log: a row for each tenth of a second, and frames decoded by `vibro.dbc`.

With a row for each frame, time stamps and row numbers would take more space than the frames. The signals of
frequent frames are already in the firmware's inputs, outputs and estimate, so a run's log holds only their
bytes, which are decoded when the log is read.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from firmware_py.interface.codec import CODEC_BY_ID, CODECS, FrameCodec
from firmware_py.interface.crc import FINAL_XOR, INITIAL, TABLE
from firmware_py.interface.dbc import SignalKind
from hil.record.candump import MOST_BYTES, BusLog, tenths_of
from hil.record.traces.precision import whole_ns
from plant_sim.arrays import BoolArray, FloatArray, IntArray

FREQUENT_PERIOD_S = 0.01
FREQUENT = frozenset(
    record.__name__
    for record, codec in CODECS.items()
    if codec.period_s is not None and codec.period_s <= FREQUENT_PERIOD_S
)
"""Names in the DBC of the frames with a rate of 100 Hz or more."""

CRC_TABLE = np.frombuffer(TABLE, np.uint8)


class FrameRows(NamedTuple):
    """Frames in rows: start time of each row in s, the number of its frames and its bytes, shapes (rows,).

    For each frame: nanoseconds since the start of its row, identifier, number of bytes, shapes (frames,).
    """

    t_s: FloatArray
    counts: IntArray
    content: list[bytes]
    after_ns: NDArray[np.int32]
    can_id: NDArray[np.uint32]
    length: NDArray[np.uint8]


def in_rows(bus: BusLog) -> FrameRows:
    """Group consecutive frames of the same tenth of a second into one row."""
    rows = tenths_of(bus)
    starts = np.flatnonzero(np.diff(rows, prepend=rows[0] - 1))
    ends = np.append(starts[1:], len(rows))
    counts = ends - starts
    last_bytes = np.concatenate([[0], np.cumsum(bus.length)])
    edges = zip(last_bytes[starts].tolist(), last_bytes[ends].tolist(), strict=True)
    sim_ns = whole_ns(bus.t_s)
    return FrameRows(
        t_s=bus.t_s[starts],
        counts=counts,
        content=[bus.content[first:last] for first, last in edges],
        after_ns=(sim_ns - np.repeat(sim_ns[starts], counts)).astype(np.int32),
        can_id=bus.can_id.astype(np.uint32),
        length=bus.length.astype(np.uint8),
    )


def one_each(values: pa.Array) -> pa.Array:
    """A component's column with one value per row."""
    return pa.ListArray.from_arrays(pa.array(np.arange(len(values) + 1, dtype=np.int32)), values)


def a_row_a_frame(table: pa.Table) -> pa.Table:
    """Expand the log's rows of frames to one row per frame, with `frame:can_id` and `frame:data`."""
    table = table.combine_chunks()
    after = contiguous(table["frame:after_ns"])
    counts = np.diff(after.offsets.to_numpy())
    after_ns = after.flatten().to_numpy().astype(np.int64)
    lengths = contiguous(table["frame:length"]).flatten().to_numpy().astype(np.int64)
    content = b"".join(contiguous(table["frame:content"]).flatten().to_pylist())
    refuse_other_lengths(lengths, len(content))
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    data = pa.Array.from_buffers(
        pa.binary(), len(lengths), [None, pa.py_buffer(offsets), pa.py_buffer(content)]
    )
    times = {
        name: pa.array(
            np.repeat(contiguous(table[name]).cast(pa.int64()).to_numpy(), counts) + after_ns
        ).cast(table[name].type)
        for name in ("sim_time", "wall_time")
    }
    ids = contiguous(table["frame:can_id"]).flatten()
    return pa.table({**times, "frame:can_id": one_each(ids), "frame:data": one_each(data)})


def refuse_other_lengths(lengths: IntArray, content_bytes: int) -> None:
    """Raise ValueError unless the lengths divide the content: Arrow reads wherever its offsets point."""
    if np.any((lengths < 0) | (lengths > MOST_BYTES)) or lengths.sum() != content_bytes:
        raise ValueError(f"the lengths of its frames are not those of their {content_bytes} bytes")


def contiguous(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array."""
    whole = column.combine_chunks()
    return whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole


class Decoded(NamedTuple):
    """Frames of one name: their indices among all frames, and one Arrow struct each."""

    rows: list[int]
    signals: pa.StructArray


class Frames(NamedTuple):
    """Decoded frames by name; and index and reason of each refused frame, in order of time."""

    by_name: dict[str, Decoded]
    refused: list[tuple[int, str]]


def signal_array(values: Sequence[float]) -> pa.Array:
    """A decoded signal; single precision exceeds the resolution of frames, and `can/raw` has their bytes."""
    return pa.array(values, pa.float32() if isinstance(values[0], float) else None)


def surely_valid(codec: FrameCodec[Any], data: NDArray[np.uint8]) -> BoolArray:
    """Mask of the frames, shape (n, 8), that certainly decode without error; others need their codec."""
    valid = np.ones(len(data), bool)
    if codec.protected:
        check = np.full(len(data), TABLE[INITIAL ^ codec.can_id & 0xFF])
        for byte in data[:, : codec.length - 1].T:
            check = CRC_TABLE[check ^ byte]
        valid &= (check ^ FINAL_XOR) == data[:, codec.length - 1]
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


def decoded(bus: BusLog, but: frozenset[str] = frozenset()) -> Frames:
    """Decode all frames, by the names of the DBC; frames named in `but` are only checked for refusal."""
    refused: list[tuple[int, str]] = []
    by_name: dict[str, Decoded] = {}
    for can_id in np.unique(bus.can_id).tolist():
        codec = CODEC_BY_ID.get(can_id)
        found = np.flatnonzero(bus.can_id == can_id)
        rows = found.tolist()
        if codec is None:
            refused += [(row, f"0x{can_id:03X}: not in the DBC") for row in rows]
            continue
        name = codec.record.__name__
        if name in but:
            refused += refused_rows(bus, codec, found)
            continue
        good: list[int] = []
        records: list[tuple[Any, ...]] = []
        for row, payload in zip(rows, bus.payloads_of(found), strict=True):
            try:
                records.append(codec.decode(payload))
            except ValueError as error:
                refused.append((row, f"0x{can_id:03X}: {error}"))
            else:
                good.append(row)
        if records and codec.record._fields:
            signals = [signal_array(values) for values in zip(*records, strict=True)]
            by_name[name] = Decoded(
                good, pa.StructArray.from_arrays(signals, names=list(codec.record._fields))
            )
    return Frames(by_name, sorted(refused))
