"""Traces: what comes back, while a writer writes and after it was killed."""

import errno
import os
import random
import signal
import subprocess
import sys
import time
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from hil.record.traces import trace


class Mode(IntEnum):
    OFF = 0
    ON = 3


class Inner(NamedTuple):
    x_m: float
    mode: Mode


class Outer(NamedTuple):
    inner: Inner
    hit: bool
    count: int


def test_nested_records_come_back_under_dotted_names(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("tick", int), ("outer", Outer), ("", Inner)]) as writer:
        writer.append(7, Outer(Inner(1.5, Mode.ON), True, -2), Inner(2.5, Mode.OFF))
    records = trace.read(path)
    assert records.dtype.names == (
        "tick",
        "outer.inner.x_m",
        "outer.inner.mode",
        "outer.hit",
        "outer.count",
        "x_m",
        "mode",
    )
    assert list(records[0]) == [7, 1.5, 3, True, -2, 2.5, 0]


def test_file_grows_past_its_window_without_losing_a_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trace, "WINDOW_BYTES", 5000)
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("tick", int), ("x", float), ("flag", bool)]) as writer:
        for tick in range(5000):
            writer.append(tick, tick / 3, tick % 2 == 0)
    records = trace.read(path)
    np.testing.assert_array_equal(records["tick"], np.arange(5000))
    np.testing.assert_array_equal(records["x"], np.arange(5000) / 3)
    np.testing.assert_array_equal(records["flag"], np.arange(5000) % 2 == 0)


def test_reader_sees_each_record_as_soon_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("tick", int)]) as writer:
        for tick in range(10):
            writer.append(tick)
            assert list(trace.read(path)["tick"]) == list(range(tick + 1))
        assert list(trace.read(path, start=8)["tick"]) == [8, 9]
        assert len(trace.read(path, start=10)) == 0


def test_closing_gives_back_the_space_that_no_record_took(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("tick", int)], expected_records=1_000_000) as writer:
        writer.append(1)
        assert path.stat().st_size > 8_000_000
    assert path.stat().st_size < 100_000


def test_file_that_is_no_trace_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    path.write_bytes(b"hello")
    with pytest.raises(trace.TraceError, match="is no trace"):
        trace.read(path)


def test_columns_of_one_name_and_types_without_a_number_are_refused(tmp_path: Path) -> None:
    with pytest.raises(trace.TraceError, match="names columns twice: x"):
        trace.TraceWriter(tmp_path / "a.trace", [("x", int), ("x", float)])
    with pytest.raises(trace.TraceError, match=r"trace column x is of type <class 'str'>"):
        trace.TraceWriter(tmp_path / "a.trace", [("x", str)])


WRITE_FOREVER = """
import sys
from itertools import count
from pathlib import Path
from hil.record.traces import trace
trace.WINDOW_BYTES = 20_000
writer = trace.TraceWriter(Path(sys.argv[1]), [("tick", int), ("twice", float)])
print("writing", flush=True)
for tick in count():
    writer.append(tick, 2.0 * tick)
"""


def test_killed_writer_leaves_every_record_it_counted(tmp_path: Path) -> None:
    rng = random.Random(1)
    for number in range(8):
        path = tmp_path / f"{number}.trace"
        with subprocess.Popen(
            [sys.executable, "-c", WRITE_FOREVER, str(path)], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "writing\n"
            time.sleep(rng.uniform(0.0, 0.05))
            os.kill(writer.pid, signal.SIGKILL)
        ticks = trace.read(path)
        np.testing.assert_array_equal(ticks["tick"], np.arange(len(ticks)))
        np.testing.assert_array_equal(ticks["twice"], 2.0 * np.arange(len(ticks)))


def test_another_writer_goes_on_where_a_killed_one_ended(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_FOREVER, str(path)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "writing\n"
        time.sleep(0.02)
        os.kill(writer.pid, signal.SIGKILL)
    written = len(trace.read(path))
    fields = [("tick", int), ("twice", float)]
    with trace.TraceWriter(path, fields, expected_records=10, resume=True) as other:
        for tick in range(written, written + 5000):
            other.append(tick, 2.0 * tick)
    records = trace.read(path)
    np.testing.assert_array_equal(records["tick"], np.arange(written + 5000))
    np.testing.assert_array_equal(records["twice"], 2.0 * np.arange(written + 5000))


def test_a_trace_of_other_columns_cannot_go_on_and_one_that_is_not_there_begins(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("x", float)], resume=True) as first:
        first.append(1.0)
    assert trace.read(path)["x"].tolist() == [1.0]
    with pytest.raises(trace.TraceError, match="other columns"):
        trace.TraceWriter(path, [("y", float)], resume=True)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EAGAIN, errno.ENOMEM])
def test_a_full_disk_costs_the_last_records_and_not_the_writer(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    allocate, room = os.posix_fallocate, 30_000

    def until_full(descriptor: int, offset: int, length: int) -> None:
        if offset + length > room:
            raise OSError(number, os.strerror(number))
        allocate(descriptor, offset, length)

    monkeypatch.setattr(trace, "WINDOW_BYTES", 5000)
    monkeypatch.setattr(os, "posix_fallocate", until_full)
    path = tmp_path / "a.trace"
    with trace.TraceWriter(path, [("tick", int)]) as writer:
        for tick in range(5000):
            writer.append(tick)
    assert 0 < writer.lost < 5000
    np.testing.assert_array_equal(trace.read(path)["tick"], np.arange(5000 - writer.lost))
    said = f"a.trace: {os.strerror(number)}; nothing is recorded from now on\n"
    assert capsys.readouterr().err == said


def test_a_run_whose_trace_has_no_room_is_refused(tmp_path: Path) -> None:
    with pytest.raises(trace.TraceError, match=r"takes 8000000.00 GB, and \d+\.\d\d GB are free: shorten"):
        trace.TraceWriter(tmp_path / "a.trace", [("tick", int)], expected_records=10**15)
    assert list(tmp_path.iterdir()) == []


def test_trace_that_lies_in_memory_is_read_through_its_link_and_brought_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, run_dir = tmp_path / "memory", tmp_path / "run"
    memory.mkdir()
    run_dir.mkdir()
    monkeypatch.setattr(trace, "MEMORY", memory)
    monkeypatch.setattr(trace, "is_user_mode_linux", lambda: True)
    path = run_dir / "plant.trace"
    with trace.TraceWriter(path, [("tick", int)]) as writer:
        writer.append(7)
        assert path.is_symlink()
        assert trace.read(path)["tick"].tolist() == [7]
    trace.bring_home(run_dir)
    assert not path.is_symlink()
    assert trace.read(path)["tick"].tolist() == [7]
    assert list(memory.iterdir()) == []
    trace.bring_home(run_dir)
    assert trace.read(path)["tick"].tolist() == [7]


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="the system does not report mappings")
def test_the_first_page_of_a_trace_is_in_memory_before_the_first_record(tmp_path: Path) -> None:
    with trace.TraceWriter(tmp_path / "a.trace", [("tick", int)]):
        mappings = Path("/proc/self/smaps").read_text().split(f"{tmp_path}/a.trace")[1:]
    assert len(mappings) == 2
    assert all(int(one.split("Rss:")[1].split()[0]) > 0 for one in mappings)
