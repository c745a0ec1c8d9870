"""Set-up finds a Python that will do, or says which it found and what to do."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[3] / "tools" / "dev" / "find-python.sh"


def find(search: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/sh", str(SCRIPT), *arguments],
        env=os.environ | {"PATH": str(search)},
        capture_output=True,
        text=True,
        check=False,
    )


def add(folder: Path, name: str, version: str, new_enough: bool, has_venv: bool) -> Path:
    """Put a stand-in for a Python in `folder`; it knows the script's three questions by their text."""
    program = folder / name
    program.write_text(
        '#!/bin/sh\ncase "$2" in\n'
        f"*print*) echo {version};;\n"
        f'*"3, 11"*) exit {int(not new_enough)};;\n'
        f"*venv*) exit {int(not has_venv)};;\n"
        "esac\n"
    )
    program.chmod(0o755)
    return program


def test_the_first_one_that_will_do_is_taken(tmp_path: Path) -> None:
    add(tmp_path, "python3", "3.9.2", new_enough=False, has_venv=True)
    add(tmp_path, "python3.13", "3.13.0", new_enough=True, has_venv=False)
    good = add(tmp_path, "python3.12", "3.12.1", new_enough=True, has_venv=True)
    add(tmp_path, "python3.11", "3.11.4", new_enough=True, has_venv=True)
    found = find(tmp_path)
    assert (found.stdout, found.stderr, found.returncode) == (f"{good}\n", "", 0)


def test_a_real_python_will_do(tmp_path: Path) -> None:
    found = find(tmp_path, sys.executable)
    assert (found.stdout, found.returncode) == (f"{sys.executable}\n", 0)


def test_without_one_each_shortcoming_and_the_remedy_are_named(tmp_path: Path) -> None:
    add(tmp_path, "python3", "3.9.2", new_enough=False, has_venv=True)
    add(tmp_path, "python3.12", "3.12.1", new_enough=True, has_venv=False)
    found = find(tmp_path)
    assert (found.stdout, found.returncode) == ("", 1)
    for words in (
        "python3 is 3.9.2",
        "python3.12 is 3.12.1 but lacks venv",
        "python3-venv",
        "make setup PYTHON=",
    ):
        assert words in found.stderr


def test_without_any_the_remedy_is_named(tmp_path: Path) -> None:
    found = find(tmp_path)
    assert found.returncode == 1
    assert "found: none" in found.stderr
