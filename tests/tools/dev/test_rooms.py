"""A folder has few enough files to be seen at once, and a file of the product's code few enough lines."""

import subprocess
from collections import Counter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[3]
TESTS = REPOSITORY / "tests"
MOST_FILES, MOST_LINES = 15, 450
LISTS = {REPOSITORY / "tools" / "commands", REPOSITORY / "hil" / "faults" / "kinds"}
"""One module a command or a kind of fault: the help and the reference list what they hold."""

FILES = [
    path
    for package in ("compilation", "firmware_py", "plant_sim", "hil", "tools", "docs", "tests")
    for path in (REPOSITORY / package).rglob("*")
    if path.is_file() and "__pycache__" not in path.parts
]


def test_a_folder_is_seen_at_once() -> None:
    """Of more files, those that share an idea get a room."""
    counts = Counter(path.parent for path in FILES if path.parent not in LISTS)
    assert len(counts) > 50
    assert {folder: count for folder, count in counts.items() if count > MOST_FILES} == {}


def test_no_two_files_of_tests_have_one_name() -> None:
    """pytest imports them by their names alone, and cannot collect the second one."""
    counts = Counter(path.name for path in FILES if path.name.startswith("test_") and path.suffix == ".py")
    assert [name for name, count in counts.items() if count > 1] == []


def test_a_file_of_code_is_no_longer_than_one_reads() -> None:
    lines = {
        path: path.read_text("utf-8").count("\n")
        for path in FILES
        if path.suffix == ".py" and TESTS not in path.parents
    }
    assert lines
    assert {path: count for path, count in lines.items() if count > MOST_LINES} == {}


def test_no_file_of_the_project_is_ignored() -> None:
    """The linter and `git add` pass over what .gitignore names: `runs/` once hid three folders of code."""
    if not (REPOSITORY / ".git").exists():
        pytest.skip("this copy is not a checkout of git")
    command = ["git", "-C", str(REPOSITORY), "ls-files", "--cached", "--ignored", "--exclude-standard"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == ""
