"""A machine without what a command needs: one sentence says what is missing, and no traceback is shown."""

import errno
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from hil.bus import BusFailedError
from hil.kernel.user_mode_linux import UmlDeathError
from hil.runs.realtime import BenchError
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


FULL = "^error: standard output cannot be written \\(No space left on device\\)\n$"
PROGRESS = "\\A( *\\d+%  .*\n)*\\Z"
"""Nothing, or what is said every ten seconds on a slow machine."""
RUN = "vibrohil run soft-start-multistable --clock lockstep --out {}/out"
SUITE = "vibrohil suite soft-start-multistable --out {}/out"
POOR: dict[str, tuple[str, set[int], str, str]] = {
    "a reader of the help that ends early": ("vibrohil --help | true", {0}, "^$", "^$"),
    "a reader of a list that ends early": ("vibrohil list scenes | true", {0}, "^$", "^$"),
    "a full disk": ("vibrohil list scenes > /dev/full", {4}, "^$", FULL),
    "a full disk for JSON": ("vibrohil list scenes --json > /dev/full", {4}, "^$", FULL),
    "no output": ("vibrohil list scenes --json >&-", {0}, "^$", "^$"),
    "no errors": ("vibrohil list scenes --json 2>&-", {0}, "table1", "^$"),
    "no streams": ("vibrohil list scenes --json <&- >&- 2>&-", {0}, "^$", "^$"),
    "a full disk for errors": ("vibrohil list scenes --json 2>/dev/full", {0}, "table1", "^$"),
    "ASCII alone": (
        "PYTHONIOENCODING=ascii vibrohil simulate table1-viscous --until 1 --set scene.drive.ratio=1.1",
        {0},
        "0\\.8803 .* \\?",
        "^$",
    ),
    "no arguments": ("vibrohil tune", {4}, "Usage: vibrohil tune", "^$"),
    "no columns": ("COLUMNS=0 vibrohil list scenes", {0}, "table1-viscous", "^$"),
    "columns that are no number": ("COLUMNS=wide vibrohil list scenes", {0}, "table1-viscous", "^$"),
    "no columns for errors": ("COLUMNS=0 vibrohil run no-such-scenario", {4}, "^$", "no-such-scenario"),
    "too few open files": (f"ulimit -n 12; {RUN}", {4}, "", "open files"),
    "a limit on the size of files": (f"exec 2>&1; ulimit -f 8; {RUN}", {1, 4}, "File too large", "^$"),
    "a limit on the size of a suite's files": (
        f"ulimit -f 1024; {SUITE}",
        {1},
        "no room on the disk",
        PROGRESS,
    ),
}
"""Command lines, each with its statuses and patterns of its output and of its errors."""


@pytest.mark.parametrize("what", POOR)
def test_a_poor_machine_gets_what_it_can_or_one_sentence(what: str, tmp_path: Path) -> None:
    command, statuses, printed, errors = POOR[what]
    shown = ended(command.format(tmp_path))
    assert shown.returncode in statuses
    assert re.search(printed, shown.stdout)
    assert re.search(errors, shown.stderr)
    assert "Traceback" not in shown.stdout + shown.stderr
    assert "defect" not in shown.stdout + shown.stderr


def test_a_library_for_which_there_is_no_address_space_is_no_defect(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = ImportError("rerun_bindings.abi3.so: failed to map segment from shared object")
    monkeypatch.setattr(error_report, "small_address_space", lambda: "this process may map 0.5 GiB")
    assert error_report.report(error, as_json=False) == EXIT_BAD_INPUT
    assert "error: this process may map 0.5 GiB" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [BenchError("no program vibrohil"), UmlDeathError("the guest died"), BusFailedError("unplugged")]
)
def test_what_the_machine_lacks_or_loses_is_no_defect(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    assert error_report.report(error, as_json=False) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.strip() == f"error: {error}"


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
