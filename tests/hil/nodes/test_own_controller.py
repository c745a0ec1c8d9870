"""A user's own controller: called in lockstep, and as a program of its own on the bus."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import hil
from text_input import TextInputError
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_PASSED

EXAMPLE = Path(__file__).parents[3] / "docs/how-to/own-controller"
CONTROLLER = f"{EXAMPLE / 'mine.py'}:tick"
STATE = "from typing import NamedTuple\nclass State(NamedTuple):\n    ticks: int = 0\nINITIAL = State()\n"


def test_the_example_is_judged_recorded_and_replayed(tmp_path: Path) -> None:
    run = hil.run(EXAMPLE / "speed.toml", firmware=CONTROLLER, out=tmp_path / "run")
    assert run.passed, run.verdict
    assert run.verdict["overruns"] == 0  # the ticks before its first heartbeat are not skipped
    t_s, target_rad_s = run.signal("firmware.own.target_rad_s")
    assert max(target_rad_s) == pytest.approx(5.6, abs=0.1)
    assert len(t_s) > 19_000
    assert cli.run(["replay", str(tmp_path / "run"), "--firmware", CONTROLLER]) == EXIT_PASSED
    assert cli.run(["inspect", str(tmp_path / "run")]) == EXIT_PASSED


def test_an_e_stop_ends_its_torque(tmp_path: Path) -> None:
    stop = {"script.commands.1.at_s": 10.0, "script.commands.1.request": "e-stop"}
    run = hil.run(EXAMPLE / "speed.toml", firmware=CONTROLLER, out=tmp_path / "run", set=stop)
    t_s, torque_n_m = run.signal("plant.motor_torque_n_m")
    assert max(abs(torque_n_m[(t_s > 5.0) & (t_s < 10.0)])) > 0.0
    assert max(abs(torque_n_m[t_s > 10.1])) == pytest.approx(0.0, abs=1e-9)


def test_a_controller_that_fails_in_a_tick_fails_its_run_and_names_the_line(tmp_path: Path, capsys) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(STATE + "def tick(config, state, rx):\n    1 / (state.ticks - 900)\n"
                    "    return State(state.ticks + 1), []\n")  # fmt: skip
    command = ["run", str(EXAMPLE / "speed.toml"), "--clock", "lockstep", "--firmware", f"{mine}:tick"]
    assert cli.run([*command, "--out", str(tmp_path / "run")]) == EXIT_CHECK_FAILED
    assert "the controller failed: ZeroDivisionError: division by zero (mine.py, line 6)" in re.sub(
        r"\s+", " ", capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("raise SystemExit(0)", r"the controller failed: SystemExit: 0 \(mine.py, line 6\)"),
        ("return State(float('nan')), []", "returned .*State.ticks=nan.*required argument is not an integer"),
        ("return (1, 2), []", "pack expected 1 items"),
        ("pass", "returned None"),
        ("return state, [(0x800, b'')]", "a frame with the identifier 0x800 and 0 bytes"),
        ("return state, [(1, bytes(9))]", "a frame with the identifier 0x1 and 9 bytes"),
        ("return state, []", "an own controller's is made from the FirmwareHeartbeat that it sends"),
    ],
)  # fmt: skip
def test_a_tick_without_a_usable_result_fails_its_run_and_says_why(
    tmp_path: Path, line: str, reason: str, capsys
) -> None:
    (tmp_path / "mine.py").write_text(f"{STATE}def tick(config, state, rx):\n    {line}\n")
    firmware = ["--firmware", f"{tmp_path / 'mine.py'}:tick", "--out", str(tmp_path / "run"), "--json"]
    brief = ["--set", "script.duration_s=0.1", "--set", "script.commands=[]"]
    command = ["run", str(EXAMPLE / "speed.toml"), "--clock", "lockstep", *brief, *firmware]
    assert cli.run(command) == EXIT_CHECK_FAILED
    reasons = json.loads(capsys.readouterr().out)["reasons"]
    assert any(re.search(reason, one) for one in reasons), reasons


def test_what_a_controller_prints_is_no_part_of_the_result(tmp_path: Path, capsys) -> None:
    (tmp_path / "mine.py").write_text(
        f"{STATE}print('imported')\ndef tick(config, state, rx):\n    print('called')\n    1 / 0\n"
    )
    command = [
        "run",
        str(EXAMPLE / "speed.toml"),
        "--clock",
        "lockstep",
        "--json",
        "--out",
        str(tmp_path / "run"),
    ]
    assert cli.run([*command, "--firmware", f"{tmp_path / 'mine.py'}:tick"]) == EXIT_CHECK_FAILED
    printed = capsys.readouterr()
    assert json.loads(printed.out)["verdict"] == "failed"
    assert "imported" in printed.err
    assert "called" in printed.err


@pytest.mark.parametrize(
    ("text", "firmware", "reason"),
    [
        ("raise SystemExit(0)", "mine.py:tick", r"fails when imported: SystemExit: 0 \(mine.py, line 1\)"),
        ("", "other.py:tick", "there is no file .*other.py; wanted FILE.py:FUNCTION"),
        (STATE, "mine.py:tick", "has no function tick"),
        ("def tick(): 1", "mine.py:tick", "has no INITIAL, the state before the first tick"),
        ("INITIAL = [1]\ndef tick(): 1", "mine.py:tick", "make INITIAL a NamedTuple"),
        ("1 / 0", "mine.py:tick", r"fails when imported: ZeroDivisionError: .* \(mine.py, line 1\)"),
    ],
)  # fmt: skip
def test_what_is_no_controller_is_refused(tmp_path: Path, text: str, firmware: str, reason: str) -> None:
    (tmp_path / "mine.py").write_text(text)
    with pytest.raises(TextInputError, match=reason):
        hil.run(EXAMPLE / "speed.toml", firmware=f"{tmp_path}/{firmware}", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_no_controller_in_lockstep_is_refused(capsys) -> None:
    command = ["run", str(EXAMPLE / "speed.toml"), "--clock", "lockstep", "--firmware", "none"]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert "another program joins the bus in real time" in capsys.readouterr().err


@pytest.mark.realtime
def test_a_program_on_the_bus_is_judged_by_what_it_sends(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("vibrohil")
    command = [program, "run", EXAMPLE / "speed.toml", "--firmware", "none", "--bus", "local"]
    with subprocess.Popen([*command, "--out", tmp_path / "run"], stderr=subprocess.PIPE, text=True) as bench:
        assert bench.stderr is not None
        lines = iter(bench.stderr.readline, "")
        bus = next(match[1] for line in lines if (match := re.search(r"--bus local:(\S+)", line)))
        with subprocess.Popen([sys.executable, EXAMPLE / "on_the_bus.py", f"vibrohil:{bus}"]) as controller:
            bench.communicate()
            assert controller.wait() == 0
    found = {check.name: check for check in hil.open_run(tmp_path / "run").judged.checks}
    assert found["fault"].value == "none"
    assert found["largest_torque"].value > 0.0  # the program has turned the crank, on any machine
