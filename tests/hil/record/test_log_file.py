"""Logs of somebody else as files: what unpacks to far more than its size is refused before it is unpacked."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from hil.record.log_file import is_whole, refuse_far_larger, repair
from hil.record.rerun_program import RerunError


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
    with pytest.raises(RerunError, match="goes on behind its end"):
        repair(tmp_path / "both.rrd")


def test_a_cut_log_is_left_to_be_mended(tmp_path: Path) -> None:
    whole = log_of(tmp_path / "a.rrd", b"abc" * 1000)
    for length in (4, 12, 20, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.rrd").write_bytes(whole[:length])
        refuse_far_larger(tmp_path / "cut.rrd")
    assert is_whole(tmp_path / "a.rrd")
