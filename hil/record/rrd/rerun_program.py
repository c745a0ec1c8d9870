"""Rerun's command-line program: its path, and an environment without usage statistics."""

import os
import subprocess
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from text_input import RefusalError


class RerunError(RefusalError, RuntimeError):
    """Rerun's program is missing or has failed."""


def rerun_program() -> Path:
    """The program that comes with rerun-sdk."""
    spec = find_spec("rerun_cli")
    folders = spec.submodule_search_locations if spec is not None else None
    for folder in folders or ():
        for name in ("rerun", "rerun.exe"):
            if (program := Path(folder) / name).exists():
                return program
    raise RerunError("rerun-sdk came without its program; install the rerun-sdk wheel of this platform")


def rerun_environment() -> dict[str, str]:
    """The environment for Rerun's program, with a settings folder in which usage statistics are disabled.

    Only a settings file disables them, no variable; a separate folder leaves the user's own settings
    unchanged.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "vibrohil-rerun-settings"
    environment = {**os.environ, "XDG_CONFIG_HOME": str(folder)}
    if not (folder / "rerun" / "analytics.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [rerun_program(), "analytics", "disable"], env=environment, capture_output=True, check=True
        )
    return environment


def rerun(arguments: Sequence[str | Path]) -> subprocess.CompletedProcess[str]:
    """Run Rerun's program to its end, without its log lines; the caller checks its exit status."""
    environment = rerun_environment() | {"RUST_LOG": "off"}
    return subprocess.run(
        [rerun_program(), *arguments], env=environment, capture_output=True, text=True, check=False
    )
