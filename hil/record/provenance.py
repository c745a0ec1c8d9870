"""The origin of a run: the commit of the code, whether files were edited, and the versions of packages."""

import hashlib
import platform
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import compilation

PACKAGES = ("vibrohil", "numpy", "numba", "filterpy", "python-can", "cantools", "rerun-sdk")
"""Packages whose versions a run reports."""
GIT_TIMEOUT_S = 5.0


def git(*arguments: str) -> str | None:
    """Git's output in the folder of this code; None without a checkout or without git.

    It takes no lock: git is killed when a run is interrupted, and the lock would remain.
    """
    here = Path(__file__).parent
    try:
        done = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(here), *arguments],
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


@cache
def sources() -> str:
    """A digest of every file of the code, since a result may depend on any of them."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for part in compilation.PACKAGES:
        for path in sorted((root / part).rglob("*")):
            if path.is_file() and path.suffix != ".pyc":
                content = path.read_bytes()
                digest.update(f"{path.relative_to(root).as_posix()} {len(content)} ".encode())
                digest.update(content)
    return digest.hexdigest()


@cache
def packages() -> dict[str, str]:
    """Versions of Python and of the packages on which results depend."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def key(*parts: object) -> str:
    """A digest of a result's inputs `parts`, and of the code and packages that compute the result.

    Stored results are named by this digest, so that no result is reused after an edit of the code.
    """
    return hashlib.sha256(repr((parts, sources(), packages())).encode()).hexdigest()


def build_of(run: Mapping[str, Any]) -> str:
    """The version and the commit of the build that made a run, from its run.json.

    >>> build_of({"versions": {"vibrohil": "0.1.0"}, "commit": "57e2f2a826bd15c3", "edited": True})
    '0.1.0 of commit 57e2f2a8, edited'
    """
    commit = f" of commit {str(run['commit'])[:8]}" if run.get("commit") else ""
    return f"{run['versions']['vibrohil']}{commit}{', edited' if run.get('edited') else ''}"


@cache
def this_build() -> str:
    """The version and the commit of this build."""
    return build_of({"versions": packages(), **commit()})


KEYS = ("commit", "edited", "changes", "seed")
"""The origin of a run, for run.json, verdict and JUnit."""


@cache
def versions() -> dict[str, str]:
    """Versions of Python, the packages and the kernel on which a run depends."""
    return {**packages(), "kernel": platform.release()}
