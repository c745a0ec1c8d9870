"""Set-up takes the quickest of the interpreters that are equal otherwise, and says so."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools.dev import quickest_python

SCRIPT = Path(__file__).parents[3] / "tools" / "dev" / "quickest_python.py"
MINOR = sys.version_info[1]


def chosen(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT)],
        env=os.environ | {"PATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )


def stand_in(folder: Path, body: str) -> None:
    program = folder / "python3"
    program.write_text(f"#!/bin/sh\n{body}\n")
    program.chmod(0o755)


def test_a_quicker_one_of_the_same_version_is_taken_and_named(tmp_path: Path) -> None:
    stand_in(tmp_path, f"echo 3 {MINOR} 1e-9 /some where/python3")
    found = chosen(tmp_path)
    assert found.stdout == "/some where/python3\n"
    assert "/some where/python3 runs what is interpreted" in found.stderr


@pytest.mark.parametrize(
    "body",
    [
        f"echo 3 {MINOR} 1e9 /slower/python3",
        f"echo 3 {MINOR - 1} 1e-9 /older/python3",
        f"echo 3 {MINOR + 1} 1e-9 /newer/python3",
        "exit 1",
        "echo no Python at all",
    ],
)
def test_else_the_default_stays(body: str, tmp_path: Path) -> None:
    stand_in(tmp_path, body)
    found = chosen(tmp_path)
    assert (found.stdout, found.stderr) == (f"{sys.executable}\n", "")


def test_without_any_other_the_default_stays(tmp_path: Path) -> None:
    assert chosen(tmp_path).stdout == f"{sys.executable}\n"


def test_one_that_is_hardly_quicker_is_not_worth_a_surprise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stand_in(tmp_path, "exit 1")
    monkeypatch.setenv("PATH", str(tmp_path))
    default = Path(sys.executable)
    times = {default: 1.0, tmp_path / "python3": 0.96}
    monkeypatch.setattr(quickest_python, "probed", lambda python: (str(python), times[python]))
    quickest_python.main()
    assert capsys.readouterr().out == f"{default}\n"
    times[tmp_path / "python3"] = 0.94
    quickest_python.main()
    assert capsys.readouterr().out == f"{tmp_path / 'python3'}\n"
