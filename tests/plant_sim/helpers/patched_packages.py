"""Copies of the project's packages, changed by diffs, and programs that run on them."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[3]


def files_of(diff: str) -> list[str]:
    return re.findall(r"^\+\+\+ b/(.*)$", diff, re.MULTILINE)


def copied(folder: Path, *packages: str) -> Path:
    """The folder, with a copy of each package in it."""
    for package in packages:
        source = REPOSITORY / package
        shutil.copytree(source, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def applied(diff: str, folder: Path, *options: str) -> None:
    subprocess.run(["git", "apply", *options, "-"], input=diff, text=True, cwd=folder, check=True)


def python(folder: Path, *arguments: str, interpreted: bool = False) -> str:
    """What Python prints on the packages in `folder`."""
    done = subprocess.run(
        [sys.executable, "-P", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "NUMBA_DISABLE_JIT": str(int(interpreted))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
