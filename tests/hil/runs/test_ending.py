"""Whatever ends a run or a suite leaves a verdict that names it, and no process."""

import errno
import json
import os
import signal
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import psutil
import pytest
from fuzzing.kill import begun
from resting import resting
from run_folder import make_run, write_run
from waiting import waited_for

from firmware_py.interface import codec
from firmware_py.interface.enums import ActingLimit, Mode, Regime
from firmware_py.interface.generated.records import FirmwareHeartbeat
from hil.judge.judge import judge
from hil.judge.verdict import failed_for
from hil.judge.verdict_files import junit_document
from hil.record import run_folder
from hil.record.run_traces import RunTraces
from hil.run_files import RunFile
from hil.runs.bench import run_scenario
from hil.runs.job import Outcome, RunOptions, silent
from hil.runs.verdict import close
from hil.scenario.scenario import load_scenario
from hil.suite.suite import Chosen, run_suite
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_INTERRUPTED

LOCKSTEP = RunOptions(clock="lockstep")

GONE_S = 30.0
"""Two seconds on a machine that does nothing else; tests run beside each other."""


def rests(folder: Path, name: str, duration_s: float) -> str:
    return str(resting(folder, name, duration_s))


def alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that still run; one that nobody has waited for yet has ended too."""
    return [
        one for one in processes if one.is_running() and one.status() not in (psutil.STATUS_ZOMBIE, "dead")
    ]


def test_a_killed_run_has_a_verdict_all_the_same(tmp_path: Path) -> None:
    out = tmp_path / "out"
    scenario = rests(tmp_path, "rests", 600.0)
    with begun(["run", scenario, "--clock", "lockstep", "--out", str(out)], tmp_path):
        waited_for((out / "operator.trace").exists)
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["passed"] is False
    assert "killed" in verdict["reasons"][0]
    assert ElementTree.parse(out / "junit.xml").getroot()[0].get("errors") == "1"


@pytest.mark.usefixtures("in_process")
def test_an_interrupted_suite_is_gone_long_before_its_end_keeps_what_is_finished_and_goes_on(
    tmp_path: Path,
) -> None:
    names = [rests(tmp_path, "quick", 0.3), *(rests(tmp_path, f"long-{n}", 900.0) for n in range(2))]
    out = tmp_path / "out"
    with begun(["suite", *names, "--out", str(out), "--jobs", "1"], tmp_path) as suite:
        # Long ones come first where there are two processes; with one the order is as given.
        waited_for((out / "long-0" / "operator.trace").exists)
        workers = psutil.Process(suite.pid).children(recursive=True)
        suite.send_signal(signal.SIGINT)
        assert suite.wait(GONE_S) == EXIT_INTERRUPTED
        waited_for(lambda: not alive(workers), GONE_S)
    result = json.loads((out / "suite.json").read_text())
    assert {one["name"]: one["passed"] for one in result["scenarios"]} == {
        "quick": True,
        **{f"long-{n}": False for n in range(2)},
    }
    assert result["scenarios"][1]["reasons"] == ["seed 1: interrupted by Ctrl-C before its end"]
    xml = ElementTree.parse(out / "junit.xml").getroot()
    assert [one.get("errors") for one in xml] == ["0", "1", "1"]
    # Goes on: what is finished is not run again, and no more than that is taken over.
    before = (out / "quick" / "run.json").stat().st_mtime_ns
    for n in range(2):
        rests(tmp_path, f"long-{n}", 0.3)
    result = run_suite(Chosen(names), LOCKSTEP, out, [1], silent, processes=1)
    assert result["passed"]
    assert (out / "quick" / "run.json").stat().st_mtime_ns == before
    # A suite that is complete starts anew.
    run_suite(Chosen(names[:1]), LOCKSTEP, out, [1], silent, processes=1)
    assert (out / "quick" / "run.json").stat().st_mtime_ns > before


@pytest.mark.parametrize("firmwares", [0, 1, 2])
def test_a_second_firmware_on_a_shared_bus_leaves_the_run_not_judged(firmwares: int, tmp_path: Path) -> None:
    made_up = make_run()
    made_up.run["bus"] = "socketcan:can0"
    can_id, data = codec.encode(FirmwareHeartbeat(Mode.RUN, ActingLimit.NONE, 0, 12.0, Regime.IMPACT), 0)
    times_s = sorted(0.1 * beat + 0.037 * late for late in range(firmwares) for beat in range(30))
    made_up.can_log = "".join(f"({t_s:.6f}) can0 {can_id:03X}#{data.hex()}\n" for t_s in times_s)
    run_dir = write_run(made_up, tmp_path)
    if firmwares == 0:  # the run has ended before its recorder began
        (run_dir / "can.log").unlink()
    verdict = close(run_dir, Outcome(**made_up.outcome))
    assert [doubt.partition(";")[0] for doubt in verdict.not_judged] == [
        "60 heartbeats of a firmware within 2.9 s, and one firmware sends 30"
    ] * (firmwares == 2)


def test_junit_stays_xml_whatever_a_process_has_written() -> None:
    reason = "firmware ended: \x1b[31mred\x1b[0m \ud800 \x0b\ufffe ok"
    verdict = failed_for(judge(RunTraces(run={"scenario": "s\x00"}), Path()), [reason])
    text = junit_document([verdict])
    error = ElementTree.fromstring(text.split("\n", 1)[1].encode()).find("testsuite/testcase/error")
    assert error is not None
    message = error.get("message") or ""
    assert "red" in message
    assert message.endswith("ok")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_in_lockstep_is_a_failed_verdict_that_says_so(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("hil.runs.recording.lines_of", full)
    scenario = load_scenario(rests(tmp_path, "rests", 0.3))
    verdict = run_scenario(scenario, LOCKSTEP, tmp_path / "out", 1, silent).as_json()
    assert verdict["passed"] is False
    assert any("no room on the disk" in reason for reason in verdict["reasons"])


def test_a_disk_that_is_full_at_the_start_leaves_a_verdict_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_anew = run_folder.write_anew

    def full(path: Path, content: bytes | str) -> None:
        if path.name == RunFile.RESERVE:
            path.touch()
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_anew(path, content)

    monkeypatch.setattr(run_folder, "write_anew", full)
    out = tmp_path / "out"
    command = ["run", rests(tmp_path, "rests", 0.3), "--clock", "lockstep", "--out", str(out)]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert "cannot be written (No space left on device)" in " ".join(capsys.readouterr().err.split())
    (reason,) = json.loads((out / "verdict.json").read_text())["reasons"]
    assert reason == "no room on the disk: [Errno 28] No space left on device"
    assert not (out / "reserve").exists()


def test_a_folder_without_permission_is_no_defect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def read_only(path: Path, *_: int, **__: Any) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    scenario = rests(tmp_path, "rests", 0.3)
    monkeypatch.setattr(Path, "mkdir", read_only)
    assert cli.run(["run", scenario, "--clock", "lockstep"]) == EXIT_BAD_INPUT
    assert "runs/ cannot be made here (Permission denied)" in " ".join(capsys.readouterr().err.split())
