"""A machine without what a command needs: one sentence says what is missing, and no traceback is shown."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(sys.executable).with_name("vibrohil")
GIB = 2**30


def test_a_folder_for_kernels_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    taken = tmp_path / "file"
    taken.touch()
    environment = os.environ | {"VIBROHIL_CACHE_DIR": str(taken)}
    ended = subprocess.run(
        [PROGRAM, "simulate", "table1-viscous"], env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 4
    assert "Traceback" not in ended.stderr
    assert "set VIBROHIL_CACHE_DIR to a writable folder" in " ".join(ended.stderr.split())


def test_an_address_space_that_is_too_small_is_named() -> None:
    ended = subprocess.run(
        [PROGRAM, "list"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 * GIB, 2 * GIB)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert "may map 2.0 GiB of memory (ulimit -v), and a run maps 3 GiB" in " ".join(ended.stderr.split())


def ended(command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A shell's command line with the program as `vibrohil`."""
    path = f"{PROGRAM.parent}:{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", command],
        env=os.environ | {"PATH": path} | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("command", ["vibrohil --help | true", "vibrohil list scenes | true"])
def test_a_reader_that_ends_early_leaves_the_status_as_it_is(command: str) -> None:
    assert (ended(command).returncode, ended(command).stderr) == (0, "")


@pytest.mark.parametrize("option", ["", "--json"])
def test_a_full_standard_output_is_one_sentence(option: str) -> None:
    full = ended(f"vibrohil list scenes {option} > /dev/full")
    assert full.returncode == 4
    assert full.stderr == "error: standard output cannot be written (No space left on device)\n"


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_closed_streams_do_not_matter(closed: str) -> None:
    assert ended(f"vibrohil list scenes --json {closed}").returncode == 0


def test_an_output_in_ascii_loses_characters_only() -> None:
    simulated = ended("vibrohil simulate table1-viscous --until 0.1", PYTHONIOENCODING="ascii")
    assert (simulated.returncode, simulated.stderr) == (0, "")
    assert "peak felt force         ?" in simulated.stdout


def test_a_command_without_its_arguments_prints_its_help_alone() -> None:
    helped = ended("vibrohil tune")
    assert (helped.returncode, helped.stderr) == (4, "")
    assert "Usage: vibrohil tune" in helped.stdout
