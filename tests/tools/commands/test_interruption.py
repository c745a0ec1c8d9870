"""A signal while the program's modules are still imported ends it as a later signal does."""

import json
import signal
import subprocess
import sys

import pytest

from tools.output import EXIT_INTERRUPTED

INTERRUPTED_IMPORT = """
import os, signal, sys

module, number = sys.argv[1], int(sys.argv[2])

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            os.kill(os.getpid(), number)

sys.meta_path.insert(0, Interrupting())
signal.signal(signal.SIGINT, signal.default_int_handler)
from tools.cli import main
sys.argv[1:] = ["list", "--json"]
main()
"""
"""Starts the program as its script does; sends itself a signal when a module's import begins."""


def interrupted_import(module: str, number: signal.Signals) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", INTERRUPTED_IMPORT, module, str(int(number))]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["typer", "numpy", "rich.console", "tools.commands.testing.run"])
def test_a_signal_during_an_import_is_an_interruption(module: str, number: signal.Signals) -> None:
    ended = interrupted_import(module, number)
    name = "Ctrl-C" if number == signal.SIGINT else "SIGTERM"
    assert ended.returncode == EXIT_INTERRUPTED, ended.stderr
    assert json.loads(ended.stdout) == {"error": f"interrupted by {name}"}
    assert ended.stderr == f"interrupted by {name}\n"
