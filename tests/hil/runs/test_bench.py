"""Real time: processes that start together, die, and are missed; runs on the wall clock, on `local`."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from compilers import require_compiler
from resting import resting

from hil.processes.child import BAD_INPUT_STATUS, Child, ChildError, ChildRefusalError
from hil.record.traces import trace
from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions, silent
from hil.scenario.scenario import Scenario, load_scenario
from tools.output import EXIT_BAD_INPUT

LOCAL = RunOptions(bus="local")

QUICK = [
    "script.duration_s=3.0",
    'script.commands=[{at_s=0.2,request="run",target_ratio=1.1},{at_s=2.6,request="idle"}]',
    "firmware.start.rise_s=1.0",
]

RIDES_THROUGH = tuple(
    f"firmware.{name}=1.0"
    for name in ("ceiling.sensor_watchdog_s", "watchdog.sensor_s", "watchdog.encoder_s")
)
"""A host stall before the firmware's death must not have stopped the motor already."""


def quick() -> Scenario:
    return load_scenario("soft-start-multistable", QUICK)


def run(run_dir: Path, scenario: Scenario | None = None) -> dict[str, Any]:
    return run_scenario(scenario or quick(), LOCAL, run_dir, 1, silent).as_json()


def run_and_disturb(
    run_dir: Path, disturb: Callable[[dict[str, int]], None], at_s: float, scenario: Scenario | None = None
) -> dict[str, Any]:
    """Run, and call `disturb` with the process numbers `at_s` after the start."""

    def watch() -> None:
        traced = run_dir / "operator.trace"
        while not traced.exists() or len(trace.read(traced)) < at_s * 100:
            time.sleep(0.005)
        disturb(json.loads((run_dir / "processes.json").read_text()))

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    verdict = run(run_dir, scenario)
    watcher.join(1.0)
    return verdict


def none_left(run_dir: Path) -> bool:
    """Whether no process of the run is there any more."""
    pids = json.loads((run_dir / "processes.json").read_text())
    pids.pop("operator")
    return not any(psutil.pid_exists(pid) for pid in pids.values())


HARMLESS = ",".join(
    f'{{at_s=1.0,duration_s=0.2,kind="{kind}",{keys}}}'
    for kind, keys in (
        ("dropped", 'frames=["OperatorCommand"]'),
        ("sensor-biased", 'sensor="housing",bias=1.0'),
        ("supply-sag", "supply_v=24.0"),
    )
)


@pytest.mark.realtime
def test_run_starts_together_keeps_its_rate_counts_what_faults_act_on_and_leaves_nothing(
    tmp_path: Path,
) -> None:
    faults = f"script.faults=[{HARMLESS}]"
    verdict = run(tmp_path, load_scenario("soft-start-multistable", [*QUICK, faults]))
    assert verdict["reasons"] == []
    assert [effect["acted_on"] for effect in verdict["faults"]] == [2, 200, 0]
    assert any("'supply-sag' at 1 s acted on nothing" in reason for reason in verdict["not_judged"])
    plant, firmware = trace.read(tmp_path / "plant.trace"), trace.read(tmp_path / "firmware.trace")
    assert plant["tick"][-1] == firmware["tick"][-1] == 2999
    assert len(plant) == 3000 - plant["overruns"][-1]
    # A tick that waits for the sensors after a pause has no record of its own: the next one counts it.
    assert len(firmware) + firmware["counters.skipped_ticks"][-1] == 3000
    offset_ns = firmware["deadline_ns"][0] - plant["deadline_ns"][0]
    assert firmware["tick"][0] == plant["tick"][0] == 0
    assert offset_ns >= 500_000  # more if time was held in between
    described = json.loads((tmp_path / "run.json").read_text())
    assert described["bus"] == "local"
    assert set(described["realtime"]) == {"firmware", "plant"}
    assert described["nodes"]["firmware"]["unsent"] == 0
    assert all("faults_acted" not in node for node in described["nodes"].values())
    assert verdict["impact_count"] > 0
    assert none_left(tmp_path)


@pytest.mark.realtime
def test_a_firmware_in_single_precision_runs_in_real_time(tmp_path: Path) -> None:
    require_compiler("gcc")
    options = RunOptions(bus="local", firmware="host-single")
    scenario = load_scenario(resting(tmp_path / "scenario"))
    assert run_scenario(scenario, options, tmp_path / "run", 1, silent).passed


@pytest.mark.realtime
def test_killed_firmware_leaves_a_motor_without_torque(tmp_path: Path) -> None:
    """Noticed although the scenario kills it itself, later."""
    killed_s: list[float] = []

    def kill(pids: dict[str, int]) -> None:
        os.kill(pids["firmware"], signal.SIGKILL)
        killed_s.append(float(trace.read(tmp_path / "operator.trace")["t_s"][-1]))

    later = 'script.faults=[{kind="killed",at_s=2.9,process="firmware"}]'
    scenario = load_scenario("soft-start-multistable", [*QUICK, later, *RIDES_THROUGH])
    verdict = run_and_disturb(tmp_path, kill, at_s=1.8, scenario=scenario)
    (at_s,) = killed_s
    assert not verdict["passed"]
    assert any(reason.startswith("firmware was killed by SIGKILL at ") for reason in verdict["reasons"])
    plant = trace.read(tmp_path / "plant.trace")
    before = plant[(plant["t_s"] > at_s - 0.2) & (plant["t_s"] < at_s)]
    after = plant[plant["t_s"] > at_s + 0.1]
    assert np.max(np.abs(before["motor_torque_n_m"])) > 0.01
    assert after["tick"][-1] - after["tick"][0] > 300  # its reaction is in the log
    assert np.max(np.abs(after["motor_torque_n_m"])) == 0.0
    assert set(after["axis_error"]) == {0x01000000}  # WATCHDOG_TIMER_EXPIRED
    assert (tmp_path / "run.rrd").exists()
    assert none_left(tmp_path)


def child(code: str, tmp_path: Path) -> Child:
    return Child("child", [sys.executable, "-c", code], tmp_path / "child.log")


def test_child_that_fails_before_it_is_ready_is_quoted(tmp_path: Path) -> None:
    failing = child("raise SystemExit('no such sensor')", tmp_path)
    with pytest.raises(ChildError, match=r"child ended with status 1 before it was ready\nno such sensor"):
        failing.wait_ready(10.0)
    failing.stop()


def test_a_child_that_blames_its_input_is_distinguished_from_one_that_fails(tmp_path: Path) -> None:
    refusing = child("import sys; print('error: no room', file=sys.stderr); raise SystemExit(4)", tmp_path)
    with pytest.raises(ChildRefusalError, match="error: no room"):
        refusing.wait_ready(10.0)
    refusing.stop()
    assert BAD_INPUT_STATUS == EXIT_BAD_INPUT


def test_child_that_fails_later_says_why_and_one_that_is_killed_does_not(tmp_path: Path) -> None:
    failing = child("raise SystemExit('no such sensor')", tmp_path)
    assert failing.wait(10.0)
    assert failing.how_it_ended() + failing.why() == "child ended with status 1: no such sensor"
    failing.stop()
    killed = child("import sys, time; print('joined', file=sys.stderr, flush=True); time.sleep(60)", tmp_path)
    while not killed.last_errors():
        time.sleep(0.01)
    killed.signal(signal.SIGKILL)
    assert killed.wait(10.0)
    assert killed.why() == ""
    killed.stop()


def test_child_that_says_nothing_is_not_waited_for_forever(tmp_path: Path) -> None:
    mute = child("import time; time.sleep(60)", tmp_path)
    with pytest.raises(ChildError, match=r"child wrote nothing for 0.2 s"):
        mute.wait_ready(0.2)
    mute.stop()
    assert mute.how_it_ended() == "child was killed by SIGTERM"


ENDS_AS_IT_IS_STOPPED = """
import os, signal, time
from hil.processes.child import stop_requests
stop_requests().close()
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(0.01)
"""


def test_child_that_is_stopped_while_it_ends_writes_no_error() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", ENDS_AS_IT_IS_STOPPED], capture_output=True, text=True, check=True
    )
    assert ended.stderr == ""


def test_child_that_is_stopped_before_it_is_ready_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.processes.child.LOOK_S", 0.1)
    held = child("import time; time.sleep(60)", tmp_path)
    held.signal(signal.SIGSTOP)
    began_s = time.monotonic()
    with pytest.raises(ChildError, match="child was stopped by a signal before it was ready"):
        held.wait_ready(120.0)
    assert time.monotonic() - began_s < 20.0
    held.stop()
    assert held.killed_at_stop


def test_child_that_is_continued_in_time_becomes_ready(tmp_path: Path) -> None:
    held = child("import time; time.sleep(0.5); print('ready', flush=True); time.sleep(60)", tmp_path)
    held.signal(signal.SIGSTOP)
    threading.Timer(1.1, held.signal, (signal.SIGCONT,)).start()
    held.wait_ready(60.0)
    held.stop()


def test_child_that_will_not_stop_is_made_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.processes.child.STOP_TIMEOUT_S", 0.3)
    stubborn = child(
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        "print('ready', flush=True); time.sleep(60)",
        tmp_path,
    )
    stubborn.wait_ready(10.0)
    stubborn.stop()
    assert stubborn.how_it_ended() == "child was killed by SIGKILL"


def test_child_that_is_at_work_has_longer_to_stop_but_a_stopped_one_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.processes.child.STOP_TIMEOUT_S", 0.3)
    code = (
        "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: (time.sleep(1.0), sys.exit()));"
        "print('ready', flush=True); time.sleep(60)"
    )
    busy, stopped = child(code, tmp_path), child(code, tmp_path)
    for one in (busy, stopped):
        one.wait_ready(10.0)
    os.kill(stopped.pid, signal.SIGSTOP)
    began_s = time.monotonic()
    stopped.stop(at_work_s=20.0)
    assert time.monotonic() - began_s < 10.0
    assert stopped.killed_at_stop
    busy.stop(at_work_s=20.0)
    assert busy.succeeded
