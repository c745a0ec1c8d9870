"""A run owns its folder: it is made exclusively, never shared, and nothing foreign in it is touched."""

import fcntl
import json
import os
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import can
import pytest
from resting import resting

from hil.bus.base import BusError
from hil.record.run_folder import (
    RunFolderError,
    claimed,
    is_in_use,
    is_written_by_oneself,
    locked,
    write_note,
)
from hil.record.run_traces import read_bus
from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions, silent
from hil.scenario.scenario import Scenario, load_scenario
from hil.suite.suite import Case, Chosen, judge_case, run_suite
from tools.cli import run
from tools.output import EXIT_BAD_INPUT

LOCKSTEP = RunOptions(clock="lockstep")

USERS_FILES = ("scenario.toml", "notes.log", "report.html", "mine.rrd")


def run_short(scenario: Scenario, out_dir: Path | None) -> dict[str, Any]:
    return run_scenario(scenario, LOCKSTEP, out_dir, 1, silent).as_json()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


FOREIGN = {
    "no run.json": None,
    "another program's run.json": '{"scenario": "mine"}',
    "a run.json that is no JSON": "mine",
    "a run.json that is a list": "[]",
}


@pytest.mark.parametrize("run_json", FOREIGN.values(), ids=FOREIGN)
def test_a_folder_that_no_run_has_made_is_refused_and_left_as_it_is(
    run_json: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = resting(tmp_path, "scenario").read_text()
    for name in USERS_FILES:
        (tmp_path / name).write_text(text)
    if run_json is not None:
        (tmp_path / "run.json").write_text(run_json)
    before = contents(tmp_path)
    arguments = ["run", str(tmp_path / "scenario.toml"), "--clock", "lockstep", "--out", str(tmp_path)]
    assert run([*arguments, "--json"]) == EXIT_BAD_INPUT
    assert contents(tmp_path) == before
    message = json.loads(capsys.readouterr().out)["error"]
    assert str(tmp_path) in message
    assert "--out" in message


def test_what_a_user_puts_into_a_run_s_folder_stays_there(tmp_path: Path) -> None:
    scenario, out = load_scenario(resting(tmp_path)), tmp_path / "out"
    run_short(scenario, out)
    for name in ("notes.log", "mine.rrd", "mine.trace"):
        (out / name).write_text("mine")
    (out / "operator.trace.new").write_text("of a run that was killed")
    run_short(scenario, out)
    for name in ("notes.log", "mine.rrd", "mine.trace"):
        assert (out / name).read_text() == "mine"
    assert not (out / "operator.trace.new").exists()


def test_runs_that_begin_in_one_second_have_a_folder_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.strftime", lambda *_: "20300101-000000")
    together, found = threading.Barrier(8), []

    def begin() -> None:
        together.wait()
        with claimed("rests", None) as run_dir:
            found.append(run_dir)

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == 8


def test_a_folder_in_use_is_refused_until_its_run_is_over(tmp_path: Path) -> None:
    scenario, out = load_scenario(resting(tmp_path)), tmp_path / "out"
    with claimed("rests", out), pytest.raises(RunFolderError, match="in use"):
        run_short(scenario, out)
    assert run_short(scenario, out)["passed"]


def test_a_folder_that_somebody_looks_at_can_be_claimed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who looks whether a folder is in use locks it for a moment: the claim waits for the end of the look."""
    looking = ExitStack()
    looking.enter_context(locked(tmp_path, shared=True))
    flock = fcntl.flock

    def lock_and_end_the_look(lock: int, kind: int) -> None:
        flock(lock, kind)
        looking.close()

    monkeypatch.setattr("hil.record.run_folder.fcntl.flock", lock_and_end_the_look)
    with claimed("rests", tmp_path):
        assert is_in_use(tmp_path)
    assert not is_in_use(tmp_path)


def test_a_run_that_breaks_off_is_not_judged_by_the_figures_of_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case(load_scenario(resting(tmp_path)), 1, tmp_path / "out", False)
    assert judge_case(case, LOCKSTEP).figures.ticks == 300

    def breaks(*_: object) -> None:
        raise RuntimeError("no compiler")

    monkeypatch.setattr("hil.runs.recording.warm_lockstep", breaks)
    verdict = judge_case(case, LOCKSTEP)
    assert verdict.passed is False
    assert verdict.figures.ticks == 0
    assert verdict.reasons[0] == "broke off: RuntimeError: no compiler"


@pytest.mark.usefixtures("in_process")
def test_a_suite_refuses_two_scenarios_of_one_name_and_runs_one_given_twice_once(tmp_path: Path) -> None:
    a, b = resting(tmp_path / "a"), resting(tmp_path / "b")
    arguments = ["suite", str(a), str(b), "--out", str(tmp_path / "out"), "--json"]
    assert run(arguments) == EXIT_BAD_INPUT
    assert not (tmp_path / "out").exists()
    result = run_suite(Chosen([str(a), str(a)]), LOCKSTEP, tmp_path / "out", [1], silent)
    assert [one["name"] for one in result["scenarios"]] == ["rests"]


@pytest.mark.usefixtures("in_process")
def test_a_suite_takes_no_folder_that_is_not_its_own(tmp_path: Path) -> None:
    name = str(resting(tmp_path))
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "junit.xml").write_text("mine")
    assert run(["suite", name, "--out", str(mine)]) == EXIT_BAD_INPUT
    assert contents(mine) == {"junit.xml": b"mine"}
    own = tmp_path / "own"
    run_suite(Chosen([name]), LOCKSTEP, own, [1], silent)
    (own / "rests" / "run.json").unlink()
    before = contents(own / "rests")
    assert run(["suite", name, "--out", str(own)]) == EXIT_BAD_INPUT
    assert contents(own / "rests") == before


def test_a_good_run_keeps_its_log_instead_of_its_traces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = {}
    for name, options in {"plain": [], "kept": ["--keep-traces"]}.items():
        out = tmp_path / name
        arguments = ["run", str(resting(tmp_path)), "--clock", "lockstep", "--out", str(out), *options]
        assert run([*arguments, "--json"]) == 0
        kept[name] = [path.name for pattern in ("can.*", "*.trace") for path in sorted(out.glob(pattern))]
    assert kept == {
        "plain": ["can.log"],
        "kept": ["can.log", "firmware.trace", "impacts.trace", "operator.trace", "plant.trace"],
    }
    can_log = tmp_path / "plain" / "can.log"
    assert can_log.read_bytes() == (tmp_path / "kept" / "can.log").read_bytes()
    assert len(list(can.LogReader(can_log))) == len(read_bus(can_log).t_s) > 900
    capsys.readouterr()
    assert run(["inspect", str(tmp_path / "plain"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ticks"] == 300


MOST_KEPT_MB_A_MINUTE = 25.0
REPORT_MB = 0.08
"""Whatever the run's length."""


@pytest.mark.parametrize("name", ["soft-start-multistable", "a-steady-walk-has-a-pulse-in-every-push-off"])
def test_what_a_good_run_keeps_has_bounds(tmp_path: Path, name: str) -> None:
    """Of the default scenario, in whose run-up and hold most signals change in every tick, and of a walk."""
    arguments = ["run", name, "--clock", "lockstep", "--firmware", "compiled"]
    assert run([*arguments, "--out", str(tmp_path / "run"), "--json"]) == 0
    kept = {path.name: path.stat().st_size for path in (tmp_path / "run").iterdir()}
    minutes = load_scenario(name).duration_s / 60.0
    assert kept.pop("report.html") < REPORT_MB * 1e6
    assert sum(kept.values()) / minutes < MOST_KEPT_MB_A_MINUTE * 1e6, kept


def test_a_link_to_nowhere_is_refused_as_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to(tmp_path / "nowhere")
    with pytest.raises(RunFolderError, match=r"is a link to .*nowhere, which does not exist"):
        run_short(load_scenario(resting(tmp_path)), tmp_path / "out")
    assert not (tmp_path / "nowhere").exists()


def test_a_new_folder_has_an_absolute_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with claimed("rests", None) as run_dir, claimed("rests", Path("out")) as given:
        assert run_dir.parent == tmp_path / "runs"
        assert given == tmp_path / "out"


def test_a_wrong_bus_leaves_no_folder_of_a_failed_run(tmp_path: Path) -> None:
    scenario = load_scenario(resting(tmp_path))
    with pytest.raises(BusError, match="nosuch:1 did not open"):
        run_scenario(scenario, RunOptions(bus="nosuch:1"), tmp_path / "out", 1, silent)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("note", "name"), [("run.json", "run.rrd.new"), ("suite.json", "index.html")])
def test_a_folder_in_the_place_of_a_file_is_reported_before_the_run(
    tmp_path: Path, note: str, name: str
) -> None:
    write_note(tmp_path / note, {})
    (tmp_path / name).mkdir()
    with pytest.raises(RunFolderError, match=f"{name} is a folder in the place of a file"):
        claimed("mine", tmp_path, note).__enter__()


@pytest.mark.parametrize("out", ["a-file/run", "x" * 300, "loop"])
def test_a_place_that_can_hold_no_folder_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").touch()
    (tmp_path / "loop").symlink_to("loop")
    command = ["run", "soft-start-multistable", "--clock", "lockstep", "--out", out]
    assert run(command) == EXIT_BAD_INPUT


def test_a_verdict_that_another_user_may_write_is_none_to_take_over(tmp_path, monkeypatch):
    verdict = tmp_path / "verdict.json"
    verdict.write_text("{}")
    tmp_path.chmod(0o755)
    verdict.chmod(0o644)
    assert is_written_by_oneself(tmp_path, verdict)
    for place, mode in ((verdict, 0o664), (verdict, 0o646), (tmp_path, 0o1777)):
        before = place.stat().st_mode
        place.chmod(mode)
        assert not is_written_by_oneself(tmp_path, verdict)
        place.chmod(before)
    monkeypatch.setattr(os, "geteuid", lambda: verdict.stat().st_uid + 1)
    assert not is_written_by_oneself(tmp_path, verdict)
