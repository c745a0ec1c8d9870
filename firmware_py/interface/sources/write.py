"""Writes a generated file, formatted by `ruff format` like all files of the project."""

import subprocess
import sys
from pathlib import Path


def formatted(text: str) -> str:
    """The Python source, formatted by `ruff format`; needs the packages of requirements-dev.lock."""
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", __file__, "-"]
    return subprocess.run(command, input=text, check=True, capture_output=True, text=True).stdout


def write(path: Path, text: str) -> None:
    """Write the text to `path`; Python is formatted first."""
    path.write_text(formatted(text) if path.suffix == ".py" else text, encoding="utf-8")
