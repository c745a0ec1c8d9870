"""The origin of a run: the commit of the code, whether it was edited since, and the machine's versions."""

import hashlib
import platform
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = ("vibrohil", "numpy", "numba", "filterpy", "python-can", "cantools", "rerun-sdk")
"""Packages whose versions a run reports."""
GIT_TIMEOUT_S = 5.0


def git(*arguments: str) -> str | None:
    """Git's output in the folder of this code; None without a checkout or without git."""
    here = Path(__file__).parent
    try:
        done = subprocess.run(
            ["git", "-C", str(here), *arguments],
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


@cache
def commit() -> dict[str, Any]:
    """The commit's hash and whether files differ from it; both None outside of a checkout."""
    if git("ls-files", "--error-unmatch", Path(__file__).name) is None:
        return {"commit": None, "edited": None}
    status = git("status", "--porcelain")
    return {"commit": git("rev-parse", "HEAD"), "edited": None if status is None else bool(status)}


PARTS = ("firmware_py", "plant_sim", "hil", "tools")


@cache
def sources() -> str:
    """A digest of every file of the code: what it computes may depend on any of them."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for part in PARTS:
        for path in sorted((root / part).rglob("*")):
            if path.is_file() and path.suffix != ".pyc":
                content = path.read_bytes()
                digest.update(f"{path.relative_to(root).as_posix()} {len(content)} ".encode())
                digest.update(content)
    return digest.hexdigest()


def key(*parts: object) -> str:
    """A digest of what a result was asked for with, and of the code and packages that computed it.

    Whoever keeps results names them by it, so that an edit never hands an old one out as new.
    """
    return hashlib.sha256(repr((parts, sources(), versions())).encode()).hexdigest()


KEYS = ("commit", "edited", "changes", "seed")
"""The origin of a run, for run.json, verdict and JUnit."""


@cache
def versions() -> dict[str, str]:
    """Versions of Python, the kernel and the packages that a run rests on."""
    packages = {name: version(name) for name in PACKAGES}
    return {"python": platform.python_version(), "kernel": platform.release(), **packages}
