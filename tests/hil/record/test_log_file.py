"""Logs of somebody else: of several recordings, or with columns that take far more memory than the file."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr

from hil.record.log_reader import tables
from hil.record.rrd.log_file import repair
from hil.record.rrd.rerun_program import RerunError


def log_of(path: Path, content: bytes) -> bytes:
    """A log with one row that holds `content`."""
    recording = rr.RecordingStream("vibrohil")
    recording.save(path)
    times = [rr.TimeColumn("sim_time", duration=np.zeros(1))]
    columns = rr.DynamicArchetype.columns(archetype="frame", components={"content": [content]})
    recording.send_columns("can/raw", times, [*columns])
    recording.disconnect()
    return path.read_bytes()


def test_a_log_with_another_behind_its_end_is_refused(tmp_path: Path) -> None:
    one, other = (log_of(tmp_path / f"{name}.rrd", b"abc") for name in "ab")
    (tmp_path / "both.rrd").write_bytes(one + other)
    with pytest.raises(RerunError, match="holds 2 recordings"):
        repair(tmp_path / "both.rrd")
    (tmp_path / "both.rrd").write_bytes(one + other[:-20])
    with pytest.raises(RerunError, match="holds 2 recordings"):
        repair(tmp_path / "both.rrd")


MANY = 20_000_000
"""Elements that take no byte or a few in a file, and 160 MB once they are read as numbers."""


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
    "array",
    [
        pa.nulls(MANY),
        pa.StructArray.from_arrays([pa.nulls(MANY)], names=["x_m"]),
        pa.Array.from_buffers(pa.struct([]), MANY, [None]),
        pa.Array.from_buffers(pa.binary(0), MANY, [None, EMPTY]),
        pa.FixedSizeListArray.from_arrays(pa.nulls(MANY), MANY),
        pa.RunEndEncodedArray.from_arrays(pa.array([MANY], pa.int32()), pa.array([0.0])),
        pa.DictionaryArray.from_arrays(pa.array([0]), pa.array([0.0])),
    ],
    ids=["null", "struct", "no fields", "no bytes", "fixed list", "runs", "dictionary"],
)
def test_columns_of_any_length_without_bytes_are_refused(tmp_path: Path, array: pa.Array) -> None:
    log_of_array(tmp_path / "a.rrd", array)
    assert (tmp_path / "a.rrd").stat().st_size < 200_000
    with pytest.raises(ValueError, match="a run logs no such column"):
        tables(tmp_path / "a.rrd")
