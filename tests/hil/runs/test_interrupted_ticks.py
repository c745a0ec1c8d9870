"""A signal during a tick ends the run after it: what a tick calls may lose the exception, or die of it."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tools.output import EXIT_INTERRUPTED

SIGNAL_AMONG_THE_RESULTS = """
import os, sys
from hil.runs import compiled
from hil.nodes.plant.steps import PlantState
Reports = PlantState.__annotations__["reports"]
make = Reports.__new__

def interrupting(kind, *values):
    if sys._getframe(1).f_code is compiled.Stretches._call.__code__:
        os.kill(os.getpid(), int(sys.argv[1]))
    return make(kind, *values)

compile_it = compiled.entry_point

def entry_point(kernel, *arguments):
    machine_code = compile_it(kernel, *arguments)
    Reports.__new__ = interrupting
    return machine_code

compiled.entry_point = entry_point
from tools.cli import run
options = ["--clock", "lockstep", "--firmware", "compiled", "--json", "--out", sys.argv[2]]
sys.exit(run(["run", "e-stop-in-the-hold", *options]))
"""
"""Sends itself a signal when compiled ticks make the first record of their results."""


SIGNAL_WHERE_EXCEPTIONS_ARE_LOST = """
import os, sys, weakref
from hil.nodes.firmware.runner import FirmwareRunner
step = FirmwareRunner.step

class Held:
    pass

def interrupting(firmware, tick):
    step(firmware, tick)
    if tick == 100:
        held = Held()
        weakref.finalize(held, os.kill, os.getpid(), int(sys.argv[1]))
        del held

FirmwareRunner.step = interrupting
from tools.cli import run
options = ["--clock", "lockstep", "--firmware", "python", "--json", "--out", sys.argv[2]]
sys.exit(run(["run", "e-stop-in-the-hold", *options]))
"""
"""Sends itself a signal in a callback, whose exceptions Python prints and forgets."""


ANOTHER_ERROR = """
import os, sys
from hil.processes.signals import Interrupted
from hil.runs import bench

def simulate(*_):
    try:
        os.kill(os.getpid(), int(sys.argv[1]))
    except Interrupted as interruption:
        raise SystemError("a function returned a result with an exception set") from interruption

bench.simulate = simulate
from tools.cli import run
options = ["--clock", "lockstep", "--firmware", "python", "--json", "--out", sys.argv[2]]
sys.exit(run(["run", "e-stop-in-the-hold", *options]))
"""
"""Compiled code makes another error of the interruption."""


@pytest.mark.parametrize(
    ("program", "number"),
    [
        (SIGNAL_AMONG_THE_RESULTS, signal.SIGINT),
        (SIGNAL_WHERE_EXCEPTIONS_ARE_LOST, signal.SIGHUP),
        (ANOTHER_ERROR, signal.SIGTERM),
    ],
    ids=["among results", "where exceptions are lost", "as another error"],
)
def test_a_signal_during_a_tick_is_an_interruption(
    program: str, number: signal.Signals, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", program, str(int(number)), str(tmp_path / "run")]
    ended = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )
    name = "Ctrl-C" if number == signal.SIGINT else number.name
    assert ended.returncode == EXIT_INTERRUPTED, ended.stderr
    assert "Exception ignored" not in ended.stderr
    assert f"interrupted by {name}" in ended.stdout
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert verdict["passed"] is False
    assert verdict["reasons"][0] == f"interrupted by {name}"
    error = ElementTree.parse(tmp_path / "run" / "junit.xml").getroot().find("testsuite/testcase/error")
    assert error is not None
    assert (error.get("message") or "").startswith(f"interrupted by {name}")
