"""Logs of somebody else as files: what unpacks to far more than its size is refused before it is unpacked."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr

from hil.record.rerun_program import RerunError
from hil.record.rrd.log_file import is_whole, refuse_far_larger, repair
from hil.record.rrd.messages import DATA, END, HEADER_BYTES, MESSAGE, TRAILER, TRAILER_MARK, fields_of


def log_of(path: Path, content: bytes) -> bytes:
    """A log with one row that holds `content`."""
    recording = rr.RecordingStream("vibrohil")
    recording.save(path)
    times = [rr.TimeColumn("sim_time", duration=np.zeros(1))]
    columns = rr.DynamicArchetype.columns(archetype="frame", components={"content": [content]})
    recording.send_columns("can/raw", times, [*columns])
    recording.disconnect()
    return path.read_bytes()


def test_a_log_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path: Path) -> None:
    packed = log_of(tmp_path / "large.rrd", bytes(300_000_000))
    assert len(packed) < 2_000_000
    with pytest.raises(RerunError, match="which unpack to 300"):
        repair(tmp_path / "large.rrd")


def test_a_log_with_another_behind_its_end_is_refused(tmp_path: Path) -> None:
    one, other = (log_of(tmp_path / f"{name}.rrd", b"abc") for name in "ab")
    refuse_far_larger(tmp_path / "a.rrd")
    (tmp_path / "both.rrd").write_bytes(one + other)
    with pytest.raises(RerunError, match="holds more than one recording"):
        repair(tmp_path / "both.rrd")
    (tmp_path / "both.rrd").write_bytes(one + other[:-20])
    with pytest.raises(RerunError, match="holds more than one recording"):
        repair(tmp_path / "both.rrd")


def test_a_cut_log_is_left_to_be_mended(tmp_path: Path) -> None:
    whole = log_of(tmp_path / "a.rrd", b"abc" * 1000)
    for length in (4, 12, 20, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.rrd").write_bytes(whole[:length])
        refuse_far_larger(tmp_path / "cut.rrd")
    assert is_whole(tmp_path / "a.rrd")


MANY = 20_000_000
"""Elements that take 160 MB once they are read as numbers, and none or a few bytes in a file."""


def log_of_array(path: Path, array: pa.Array) -> None:
    """A log with one row, which holds an array."""
    recording = rr.RecordingStream("vibrohil")
    recording.save(path)
    times = [rr.TimeColumn("sim_time", duration=np.zeros(1))]
    columns = rr.DynamicArchetype.columns(archetype="trace", components={"record": array})
    recording.send_columns("plant", times, [*columns.partition([len(array)])])
    recording.disconnect()


EMPTY = pa.py_buffer(b"")


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        (pa.nulls(MANY), "unpack to 16"),
        (pa.StructArray.from_arrays([pa.nulls(MANY)], names=["x_m"]), "unpack to 32"),
        (pa.Array.from_buffers(pa.struct([]), MANY, [None]), "unpack to 16"),
        (pa.Array.from_buffers(pa.binary(0), MANY, [None, EMPTY]), "unpack to 16"),
        (pa.FixedSizeListArray.from_arrays(pa.nulls(MANY), MANY), "unpack to 16"),
        (pa.RunEndEncodedArray.from_arrays(pa.array([MANY], pa.int32()), pa.array([0.0])), "the type .*run"),
        (pa.DictionaryArray.from_arrays(pa.array([0]), pa.array([0.0])), "the type .*dictionary"),
    ],
    ids=["null", "struct", "no fields", "no bytes", "fixed list", "runs", "dictionary"],
)
def test_arrays_that_take_more_memory_than_bytes_are_refused(
    tmp_path: Path, array: pa.Array, sentence: str
) -> None:
    log_of_array(tmp_path / "a.rrd", array)
    assert (tmp_path / "a.rrd").stat().st_size < 200_000
    with pytest.raises(RerunError, match=f"{sentence}.*; a run makes no such log"):
        repair(tmp_path / "a.rrd")


def encoded(fields: list[tuple[int, int | bytes]]) -> bytes:
    """Fields in the format of protocol buffers."""

    def varint(number: int) -> bytes:
        more = number >> 7
        return bytes([number & 0x7F | (0x80 if more else 0)]) + (varint(more) if more else b"")

    return b"".join(
        varint(field << 3) + varint(value)
        if isinstance(value, int)
        else varint(field << 3 | 2) + varint(len(value)) + value
        for field, value in fields
    )


def changed(log: bytes, kind: int, change: Callable[[bytes], bytes]) -> bytes:
    """The log with all messages of one kind changed, and with a footer if it has a last message."""
    place, made = HEADER_BYTES, log[:HEADER_BYTES]
    while True:
        its_kind, length = MESSAGE.unpack_from(log, place)
        place += MESSAGE.size
        content = log[place : place + length]
        content = change(content) if its_kind == kind else content
        made += MESSAGE.pack(its_kind, len(content))
        if its_kind == END:
            return made + content + TRAILER.pack(len(made), len(content), 0, TRAILER_MARK, 1)
        made += content
        place += length


def stream_of(packed: bytes, size: int) -> pa.RecordBatch:
    unpacked = pa.Codec("lz4_raw").decompress(packed, size, asbytes=True)
    return pa.ipc.open_stream(unpacked).read_next_batch()


def packed_once_more(message: bytes) -> bytes:
    """The message with its arrays compressed within Arrow's own format too."""
    fields = dict(fields_of(message))
    batch, written = stream_of(fields[5], fields[3]), io.BytesIO()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(written, batch.schema, options=options) as writer:
        writer.write_batch(batch)
    return encoded([*(fields | {2: 1, 3: len(written.getvalue()), 5: written.getvalue()}).items()])


def with_table(end: bytes, change: Callable[[dict[int, int | bytes]], dict[int, int | bytes]]) -> bytes:
    """The footer with the table of its recording's places changed."""
    manifests = []
    for field, manifest in fields_of(end):
        parts = [
            (4, encoded([*change(dict(fields_of(one))).items()])) if n == 4 else (n, one)
            for n, one in fields_of(manifest)
        ]
        manifests.append((field, encoded(parts)))
    return encoded(manifests)


def places(table: dict[int, int | bytes], change: Callable[[list[int]], list[int]]) -> dict[int, int | bytes]:
    """The table with other places."""
    batch, written = stream_of(table[2], table[4]), io.BytesIO()
    number = batch.schema.get_field_index("chunk_byte_offset")
    column = pa.array(change(batch.column(number).to_pylist()), pa.uint64())
    batch = batch.set_column(number, batch.schema.field(number), column)
    with pa.ipc.new_stream(written, batch.schema) as writer:
        writer.write_batch(batch)
    return table | {2: written.getvalue(), 3: 1, 4: len(written.getvalue())}


@pytest.mark.parametrize(
    ("kind", "change", "sentence"),
    [
        (DATA, packed_once_more, "holds Arrow data that are compressed once more"),
        (DATA, lambda message: b"\x7b\x08\x01\x7c" + message, "a field of the unknown kind 3"),
        (DATA, lambda message: message + encoded([(2, 7)]), "the unknown compression 7"),
        (DATA, lambda message: message[:-40], "a field beyond its end"),
        (END, lambda end: with_table(end, lambda table: table | {4: 8_000_000_000}), "unpack to 800"),
        (END, lambda end: with_table(end, lambda table: places(table, lambda at: [0] * len(at))), "or twice"),
        (
            END,
            lambda end: with_table(end, lambda table: places(table, lambda at: [12] * len(at))),
            "or twice",
        ),
    ],
)
def test_messages_of_another_making_are_refused(
    tmp_path: Path, kind: int, change: Callable[[bytes], bytes], sentence: str
) -> None:
    whole = log_of(tmp_path / "a.rrd", b"abc" * 1000)
    (tmp_path / "a.rrd").write_bytes(changed(whole, kind, lambda message: message))
    refuse_far_larger(tmp_path / "a.rrd")
    (tmp_path / "a.rrd").write_bytes(changed(whole, kind, change))
    with pytest.raises(RerunError, match=f"{sentence}.*; a run makes no such log"):
        repair(tmp_path / "a.rrd")


def test_a_footer_outside_of_the_last_message_is_refused(tmp_path: Path) -> None:
    whole = log_of(tmp_path / "a.rrd", b"abc" * 1000)
    place, length, *rest = TRAILER.unpack(whole[-TRAILER.size :])
    (tmp_path / "a.rrd").write_bytes(whole[: -TRAILER.size] + TRAILER.pack(place - 1, length, *rest))
    with pytest.raises(RerunError, match="a footer that is not its last message"):
        repair(tmp_path / "a.rrd")
