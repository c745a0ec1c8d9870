"""A machine without what a command needs: one sentence says what is missing, and no traceback is shown."""

import os
import resource
import subprocess
import sys
from pathlib import Path

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
