"""Whatever ends a run or a suite leaves a verdict that names it, and no process."""

import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import psutil
import pytest
from resting import resting
from waiting import waited_for

from hil.bench.bench import run_scenario
from hil.bench.lockstep import silent
from hil.bench.options import RunOptions
from hil.bench.verdict import failed_for
from hil.judge import junit
from hil.judge.judge import judge
from hil.record.run_traces import RunTraces
from hil.record.traces import trace
from hil.record.traces.trace import TraceWriter
from hil.scenario.scenario import load_scenario
from hil.suite.suite import Chosen, run_suite
from hil.timing.loop import FixedRateLoop
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_INTERRUPTED

LOCKSTEP = RunOptions(clock="lockstep")

PROGRAM = Path(sys.executable).with_name("vibrohil")
GONE_S = 6.0
"""Two seconds on a machine that does nothing else; tests run beside each other."""


def rests(folder: Path, name: str, duration_s: float) -> str:
    return str(resting(folder, name, duration_s))


def has_begun(run_dir: Path) -> bool:
    """Whether a run has come some ticks far."""
    traced = run_dir / "operator.trace"
    return traced.exists() and len(trace.read(traced)) > 20


def alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that still run; one that nobody has waited for yet has ended too."""
    return [
        one for one in processes if one.is_running() and one.status() not in (psutil.STATUS_ZOMBIE, "dead")
    ]


def heeding_hang_ups() -> None:
    """As a program in a terminal does, even if these tests run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def begin() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the program with these arguments; kills what a failed test leaves running, workers included."""
    begun: list[subprocess.Popen[str]] = []

    def begin(*arguments: str | Path, stdout: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
        begun.append(
            subprocess.Popen(
                [PROGRAM, *arguments],
                stdout=stdout,
                stderr=subprocess.DEVNULL,
                text=True,
                preexec_fn=heeding_hang_ups,  # noqa: PLW1509  one system call, no lock
            )
        )
        return begun[-1]

    yield begin
    for program in begun:
        if program.poll() is None:
            workers = psutil.Process(program.pid).children(recursive=True)
            for process in (psutil.Process(program.pid), *workers):
                process.kill()
            program.wait()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_lockstep_is_named_by_the_verdict(
    number: signal.Signals, tmp_path: Path, begin: Callable[..., subprocess.Popen[str]]
) -> None:
    out = tmp_path / "out"
    bench = begin(
        "run", rests(tmp_path, "rests", 600.0), "--clock", "lockstep", "--firmware", "python", "--out", out
    )
    waited_for(lambda: has_begun(out))
    bench.send_signal(number)
    assert bench.wait(60.0) == EXIT_INTERRUPTED
    verdict = json.loads((out / "verdict.json").read_text())
    name = "Ctrl-C" if number == signal.SIGINT else number.name
    assert (verdict["passed"], verdict["reasons"]) == (False, [f"interrupted by {name}"])
    error = ElementTree.parse(out / "junit.xml").getroot().find("testsuite/testcase/error")
    assert error is not None
    assert error.get("message") == f"interrupted by {name}"


def test_a_killed_run_has_a_verdict_all_the_same(
    tmp_path: Path, begin: Callable[..., subprocess.Popen[str]]
) -> None:
    out = tmp_path / "out"
    bench = begin("run", rests(tmp_path, "rests", 600.0), "--clock", "lockstep", "--out", out)
    waited_for((out / "operator.trace").exists)
    bench.kill()
    bench.wait()
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["passed"] is False
    assert "killed" in verdict["reasons"][0]
    assert ElementTree.parse(out / "junit.xml").getroot()[0].get("errors") == "1"


def test_an_interrupted_suite_is_gone_in_two_seconds_keeps_what_is_finished_and_goes_on(
    tmp_path: Path, begin: Callable[..., subprocess.Popen[str]]
) -> None:
    names = [rests(tmp_path, "quick", 0.3), *(rests(tmp_path, f"long-{n}", 900.0) for n in range(4))]
    out = tmp_path / "out"
    suite = begin("suite", *names, "--out", out, "--jobs", "1")
    # Long ones come first where there are two processes; with one the order is as given.
    waited_for((out / "long-0" / "operator.trace").exists)
    workers = psutil.Process(suite.pid).children(recursive=True)
    suite.send_signal(signal.SIGINT)
    assert suite.wait(GONE_S) == EXIT_INTERRUPTED
    waited_for(lambda: not alive(workers), GONE_S)
    result = json.loads((out / "suite.json").read_text())
    assert {one["name"]: one["passed"] for one in result["scenarios"]} == {
        "quick": True,
        **{f"long-{n}": False for n in range(4)},
    }
    assert result["scenarios"][1]["reasons"] == ["seed 1: interrupted by Ctrl-C before its end"]
    xml = ElementTree.parse(out / "junit.xml").getroot()
    assert [one.get("errors") for one in xml] == ["0", "1", "1", "1", "1"]
    # Goes on: what is finished is not run again, and no more than that is taken over.
    before = (out / "quick" / "run.json").stat().st_mtime_ns
    for n in range(4):
        rests(tmp_path, f"long-{n}", 0.3)
    result = run_suite(Chosen(names), LOCKSTEP, out, [1], silent, processes=1)
    assert result["passed"]
    assert (out / "quick" / "run.json").stat().st_mtime_ns == before
    # A suite that is complete starts anew.
    run_suite(Chosen(names[:1]), LOCKSTEP, out, [1], silent, processes=1)
    assert (out / "quick" / "run.json").stat().st_mtime_ns > before


def test_a_killed_worker_costs_only_its_scenario(
    tmp_path: Path, begin: Callable[..., subprocess.Popen[str]]
) -> None:
    names = [rests(tmp_path, "long", 900.0), *(rests(tmp_path, f"quick-{n}", 0.3) for n in range(3))]
    out = tmp_path / "out"
    suite = begin("suite", *names, "--out", out, "--jobs", "2", "--json", stdout=subprocess.PIPE)
    described = out / "long" / "processes.json"
    waited_for(described.exists)
    waited_for((out / "long" / "operator.trace").exists)
    os.kill(json.loads(described.read_text())["lockstep"], signal.SIGKILL)
    printed, _ = suite.communicate(timeout=120.0)
    found = {one["name"]: one for one in json.loads(printed)["scenarios"]}
    assert {name: one["passed"] for name, one in found.items()} == {
        "long": False,
        **{f"quick-{n}": True for n in range(3)},
    }
    assert any("killed by SIGKILL" in reason for reason in found["long"]["reasons"])


def test_junit_stays_xml_whatever_a_process_has_written() -> None:
    reason = "firmware ended: \x1b[31mred\x1b[0m \ud800 \x0b\ufffe ok"
    verdict = failed_for(judge(RunTraces(run={"scenario": "s\x00"}), Path()), [reason])
    text = junit.document([verdict])
    error = ElementTree.fromstring(text.split("\n", 1)[1].encode()).find("testsuite/testcase/error")
    assert error is not None
    message = error.get("message") or ""
    assert "red" in message
    assert message.endswith("ok")


class StoppedAsleep:
    """A clock in whose first sleep the loop is stopped."""

    loop: FixedRateLoop

    def now_ns(self) -> int:
        return 0

    def sleep_until(self, deadline_ns: int) -> None:
        self.loop.stop()


def test_a_loop_that_is_stopped_in_its_sleep_does_not_tick() -> None:
    clock = StoppedAsleep()
    clock.loop = FixedRateLoop(clock, 0, 1_000_000)
    ticks: list[int] = []
    clock.loop.run(10, lambda tick, _: ticks.append(tick), lambda *_: None)
    assert ticks == []


FULL = [errno.ENOSPC, errno.EDQUOT, errno.EAGAIN, errno.ENOMEM]


@pytest.mark.parametrize("number", FULL, ids=[errno.errorcode[number] for number in FULL])
def test_a_trace_without_room_counts_what_it_loses(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("hil.record.traces.trace.WINDOW_BYTES", 4096)
    with TraceWriter(tmp_path / "x.trace", [("t_s", float)]) as writer:
        monkeypatch.setattr("os.posix_fallocate", full)
        for tick in range(2000):
            writer.append(float(tick))
        assert writer.lost > 0
        assert writer.count + writer.lost == 2000


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_in_lockstep_is_a_failed_verdict_that_says_so(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    for method in ("write", "append"):  # tick by tick, and in compiled stretches
        monkeypatch.setattr(f"hil.bus.can_log.CanLog.{method}", full)
    scenario = load_scenario(rests(tmp_path, "rests", 0.3))
    verdict = run_scenario(scenario, LOCKSTEP, tmp_path / "out", 1, silent).as_json()
    assert verdict["passed"] is False
    assert any("no room on the disk" in reason for reason in verdict["reasons"])


def test_a_disk_that_is_full_at_the_start_leaves_a_verdict_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(path: Path, _: bytes) -> None:
        path.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
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
    def read_only(path: Path, **_: Any) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    scenario = rests(tmp_path, "rests", 0.3)
    monkeypatch.setattr(Path, "mkdir", read_only)
    assert cli.run(["run", scenario, "--clock", "lockstep"]) == EXIT_BAD_INPUT
    assert "runs/ cannot be made here (Permission denied)" in " ".join(capsys.readouterr().err.split())
