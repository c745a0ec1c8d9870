"""A machine without what a command needs: one sentence says what is missing, and no traceback is shown."""

import errno
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tools import error_report
from tools.output import EXIT_BAD_INPUT, EXIT_INTERNAL_ERROR

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


def test_what_runs_no_kernel_wants_no_folder_for_kernels(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    commands = "vibrohil list && vibrohil list scenes && vibrohil list --show soft-start-multistable"
    listed = ended(commands, VIBROHIL_CACHE_DIR=str(tmp_path / "file"))
    assert (listed.returncode, listed.stderr) == (0, "")


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
    cut = ended(command)
    assert (cut.returncode, cut.stderr) == (0, "")


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


@pytest.mark.parametrize("columns", ["0", "wide"])
def test_a_terminal_of_no_columns_shows_results_and_errors(columns: str) -> None:
    assert "table1-viscous" in ended("vibrohil list scenes", COLUMNS=columns).stdout
    wrong = ended("vibrohil run no-such-scenario", COLUMNS=columns)
    assert "no-such-scenario" in wrong.stderr
    assert wrong.returncode == 4


def test_too_few_open_files_are_one_sentence(tmp_path: Path) -> None:
    few = ended(f"ulimit -n 12; vibrohil run soft-start-multistable --clock lockstep --out {tmp_path}/out")
    assert "Traceback" not in few.stderr
    assert "defect" not in few.stderr
    assert few.returncode == 4
    assert "open files" in few.stderr


def test_a_limit_on_the_size_of_files_is_one_sentence(tmp_path: Path) -> None:
    short = ended(f"ulimit -f 8; vibrohil run soft-start-multistable --clock lockstep --out {tmp_path}/out")
    assert "Traceback" not in short.stderr
    assert "defect" not in short.stderr
    assert "File too large" in short.stdout + short.stderr
    assert short.returncode in (1, 4)


def test_a_library_for_which_there_is_no_address_space_is_no_defect(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = ImportError("rerun_bindings.abi3.so: failed to map segment from shared object")
    monkeypatch.setattr(error_report, "small_address_space", lambda: "this process may map 0.5 GiB")
    assert error_report.report(error, as_json=False) == EXIT_BAD_INPUT
    assert "error: this process may map 0.5 GiB" in capsys.readouterr().err


@pytest.mark.parametrize(
    "number", [errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP]
)
def test_a_file_that_cannot_be_used_is_named_and_without_a_file_it_is_a_defect(
    number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    named = OSError(number, os.strerror(number), "some/file")
    assert error_report.report(named, as_json=False) == EXIT_BAD_INPUT
    assert f"some/file cannot be used ({os.strerror(number)})" in " ".join(capsys.readouterr().err.split())
    assert error_report.report(OSError(number, os.strerror(number)), False) == EXIT_INTERNAL_ERROR
    assert "a defect of vibrohil; its traceback:" in " ".join(capsys.readouterr().err.split())
