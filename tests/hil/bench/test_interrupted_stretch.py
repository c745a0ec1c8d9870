"""A signal during compiled ticks ends the run; numba's conversion of their results survives no exception."""

import json
import signal
import subprocess
import sys

import pytest

from tools.output import EXIT_INTERRUPTED

SIGNAL_AMONG_THE_RESULTS = """
import os, sys
from hil.bench import stretches
from hil.nodes.closed_loop import Loop
Reports = Loop.__annotations__["reports"]
make = Reports.__new__

def interrupting(kind, *values):
    if sys._getframe(1).f_code is stretches.Stretches.run.__code__:
        os.kill(os.getpid(), int(sys.argv[1]))
    return make(kind, *values)

compiled = stretches.entry_point

def entry_point(kernel, *arguments):
    machine_code = compiled(kernel, *arguments)
    Reports.__new__ = interrupting
    return machine_code

stretches.entry_point = entry_point
from tools.cli import run
options = ["--clock", "lockstep", "--firmware", "compiled", "--json", "--out", sys.argv[2]]
sys.exit(run(["run", "e-stop-in-the-hold", *options]))
"""
"""Sends itself a signal when compiled ticks make the first record of their results."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_compiled_ticks_is_an_interruption(number: signal.Signals, tmp_path) -> None:
    command = [sys.executable, "-c", SIGNAL_AMONG_THE_RESULTS, str(int(number)), str(tmp_path / "run")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    name = "Ctrl-C" if number == signal.SIGINT else "SIGTERM"
    assert ended.returncode == EXIT_INTERRUPTED, ended.stderr
    assert f"interrupted by {name}" in ended.stdout
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert verdict["reasons"][0] == f"interrupted by {name}"
