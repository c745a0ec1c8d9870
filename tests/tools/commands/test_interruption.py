"""A signal while the program's modules are imported or its kernels compiled ends it as a later one does."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tools.output import EXIT_INTERRUPTED

INTERRUPTED_IMPORT = """
import os, signal, sys

module, number, before = sys.argv[1], int(sys.argv[2]), getattr(signal, sys.argv[3])

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            os.kill(os.getpid(), number)

sys.meta_path.insert(0, Interrupting())
signal.signal(signal.SIGINT, before)
from tools.cli import main
sys.argv[1:] = ["list", "--json"]
main()
"""
"""Starts the program as its script does; sends itself a signal when a module's import begins."""


def interrupted_import(
    module: str, number: signal.Signals, before: str = "default_int_handler"
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", INTERRUPTED_IMPORT, module, str(int(number)), before]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["typer", "numpy", "rich.console", "tools.commands.list_names"])
def test_a_signal_during_an_import_is_an_interruption(module: str, number: signal.Signals) -> None:
    ended = interrupted_import(module, number)
    name = "Ctrl-C" if number == signal.SIGINT else "SIGTERM"
    assert ended.returncode == EXIT_INTERRUPTED, ended.stderr
    assert json.loads(ended.stdout) == {"error": f"interrupted by {name}"}
    assert ended.stderr == f"interrupted by {name}\n"


def test_a_program_in_the_background_of_a_script_ends_by_sigint() -> None:
    """A shell without job control starts such a program with SIGINT ignored."""
    ended = interrupted_import("typer", signal.SIGINT, "SIG_IGN")
    assert (ended.returncode, ended.stderr) == (EXIT_INTERRUPTED, "interrupted by Ctrl-C\n")


INTERRUPTED_COMPILATION = """
import os, signal, sys
from numba.core.compiler_machinery import PassManager

run = PassManager.run

def interrupting(manager, state):
    os.kill(os.getpid(), signal.SIGTERM)
    print("compiles", file=sys.stderr)
    return run(manager, state)

PassManager.run = interrupting
from tools.cli import main
main()
"""
"""Starts the program; sends it a signal whenever the compilation of a function begins."""


def test_a_signal_during_a_compilation_is_an_interruption(tmp_path: Path) -> None:
    command = [sys.executable, "-c", INTERRUPTED_COMPILATION, "run", "soft-start-multistable"]
    options = ["--clock", "lockstep", "--out", str(tmp_path / "run"), "--json"]
    environment = os.environ | {"VIBROHIL_CACHE_DIR": str(tmp_path / "kernels")}
    ended = subprocess.run([*command, *options], capture_output=True, text=True, check=False, env=environment)
    assert ended.returncode == EXIT_INTERRUPTED, ended.stderr
    assert json.loads(ended.stdout) == {"error": "interrupted by SIGTERM"}
    assert ended.stderr == "interrupted by SIGTERM\n"
