"""Damaged files of a run: what is still readable is used, and the rest is said in a sentence."""

import os
import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from run_folder import make_run, write_run

from hil.judge.judge import judge
from hil.record.candump import StoredBus, parse_candump
from hil.record.damage import DamagedFileError, reading
from hil.record.provenance import commit, packages, this_build
from hil.record.rrd.log_file import repair
from hil.record.rrd.rerun_program import RerunError
from hil.record.run_traces import read_run
from hil.runs.recorded_run import cause, rebuilt

FILES = (
    *("run.json", "outcome.json", "scenario.toml"),
    *("plant.trace", "firmware.trace", "impacts.trace", "operator.trace", "can.log"),
)


def cut(content: bytes) -> bytes:
    return content[: len(content) // 3]


def emptied(_: bytes) -> bytes:
    return b""


def noise(content: bytes) -> bytes:
    return np.random.default_rng(1).bytes(len(content))


def flipped_at_its_head(content: bytes) -> bytes:
    damaged = bytearray(content)
    for place in np.random.default_rng(2).integers(0, min(len(damaged), 60), 20).tolist():
        damaged[place] ^= 0x55
    return bytes(damaged)


def another_value(content: bytes) -> bytes:
    return b"[1, 2]"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(make_run(), tmp_path_factory.mktemp("whole") / "run")


@pytest.mark.parametrize("damage", [cut, emptied, noise, flipped_at_its_head, another_value])
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_of_a_run_is_named_and_the_others_are_read(
    name: str, damage: Callable[[bytes], bytes], whole: Path
) -> None:
    path = whole / name
    content = path.read_bytes()
    try:
        path.write_bytes(damage(content))
        traces = read_run(whole)
    finally:
        path.write_bytes(content)
    others = {"plant.trace": traces.firmware, "firmware.trace": traces.plant}.get(name, traces.firmware)
    assert len(others) > 1000
    if (damage is cut and name.endswith((".trace", ".log"))) or (damage is emptied and name == "can.log"):
        return  # like the file of a run that was killed: what is whole of it is read
    said = [one for one in traces.damage if name in one]
    assert len(said) == 1, traces.damage
    try:
        with reading(whole, "nothing"):
            verdict = judge(traces, whole).as_json()
    except DamagedFileError:
        return
    assert not verdict["passed"]
    assert said[0] in verdict["reasons"]


def test_frames_are_read_around_damaged_lines() -> None:
    log = parse_candump(
        b"(1.000000) vcan0 080#0102\n"
        b"(1.001000) vcan0 080#010\n"
        b"(1.002000) vcan0 FFFFFFFFFFFFFFFFFFFF#00\n"
        b"\xff\xfe\x00\n"
        b"(1.003000) vcan0 080#03\n"
    )
    assert log.t_s.tolist() == [1.0, 1.003]


def test_a_file_without_ends_of_lines_is_not_kept_in_memory(tmp_path: Path) -> None:
    log = tmp_path / "can.log"
    log.touch()
    os.truncate(log, 200 << 20)
    tracemalloc.start()
    assert sum(len(piece.t_s) for piece in StoredBus(log).pieces()) == 0
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40 << 20


def test_a_log_that_cannot_be_made_anew_leaves_no_unfinished_one(tmp_path: Path) -> None:
    run = write_run(make_run(), tmp_path / "run")
    (run / "run.json").write_text('{"wall_start_s": "noon"}')
    with pytest.raises(DamagedFileError):
        rebuilt(run)
    assert not list(run.glob("*.new"))


@pytest.mark.parametrize(
    ("name", "spoil", "sentence"),
    [
        (
            "can.log",
            lambda text: text + b"(99999999999.000000) vcan0 010#0011\n",
            "has the time 1e\\+11 s, and",
        ),
        (
            "scenario.toml",
            lambda _: b'title = "t"\nscene = "table1-motor-soft"\n[script]\nduration_s = 0.1\n',
            r"\(a value of another type than wanted: 'str' object",
        ),
    ],
)
def test_values_that_no_run_writes_are_named_without_a_warning(
    tmp_path: Path, name: str, spoil: Callable[[bytes], bytes], sentence: str
) -> None:
    run = write_run(make_run(), tmp_path / "run")
    (run / name).write_bytes(spoil((run / name).read_bytes()))
    with pytest.raises(DamagedFileError, match=sentence):
        rebuilt(run)


def test_a_file_that_does_not_begin_as_a_log_is_none(tmp_path: Path) -> None:
    log = tmp_path / "run.rrd"
    log.touch()
    os.truncate(log, 3 << 30)
    with pytest.raises(RerunError, match="no Rerun log"):
        repair(log)


def test_a_run_of_another_build_is_refused_with_both_builds(tmp_path: Path) -> None:
    made_up = make_run()
    made_up.run |= {"versions": {"vibrohil": "0.0.9"}, "commit": "0123456789abcdef", "edited": False}
    run = write_run(made_up, tmp_path / "run")
    rebuilt(run)
    (run / "scenario.toml").write_text('title = "t"\nscene = "table1-motor-soft"\n')
    both = f"was made by vibrohil 0.0.9 of commit 01234567, which may differ from this {this_build()}"
    with pytest.raises(DamagedFileError, match=re.escape(both)):
        rebuilt(run)
    assert cause(lambda: made_up.run).startswith(both)
    assert cause(lambda: {"versions": packages(), **commit()}) == "is damaged"
    assert cause(lambda: {}) == "is damaged, or of another version"


def test_what_has_another_cause_is_no_damage() -> None:
    with pytest.raises(KeyboardInterrupt), reading(Path("x"), "nothing"):
        raise KeyboardInterrupt
    said = r"x is damaged, or of another version \(ZeroDivisionError: y\); try z"
    with pytest.raises(DamagedFileError, match=said) as error, reading(Path("x"), "try z"):
        raise ZeroDivisionError("y")
    assert isinstance(error.value.__cause__, ZeroDivisionError)
