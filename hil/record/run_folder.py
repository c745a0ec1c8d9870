"""The run folder before and during a run; hil.bench.verdict judges its content afterwards.

A run owns its folder: `claimed` makes a new folder, or takes one that is empty or was made by a run according
to its `run.json`, and locks it. Only files that a run writes are ever removed.
"""

import fcntl
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hil.record.run_traces import CAN_LOG
from hil.record.traces import trace

RUNS = Path("runs")
RUN_NOTE, SUITE_NOTE = "run.json", "suite.json"
VERDICT = "verdict.json"
RESERVE = "reserve"
WARM_UP = "warm-up"
"""Subfolder of the short run that compiles and loads all code in advance."""
RESERVE_BYTES = 2 << 20
"""Disk space reserved for verdict, JUnit and outcome in case a run fills the disk."""
MADE_BY = "made_by"
"""Key in a folder's note that marks the folder as made by this program."""
MAKER = "vibrohil"

TRACES = ("plant", "firmware", "impacts", "operator", "bus_errors")
PROCESSES = ("firmware", "plant", "firmware-again", "plant-again", "baseline", "recorder", "live")
WRITTEN_WHOLE = (
    *(f"{name}.trace" for name in TRACES),
    *("run.rrd", RUN_NOTE, "outcome.json", "processes.json", "losses.json", VERDICT),
)
MADE_BY_A_RUN = (
    *WRITTEN_WHOLE,
    *(f"{name}.new" for name in WRITTEN_WHOLE),
    *(f"{name}.log" for name in PROCESSES),
    *("scenario.toml", CAN_LOG, "junit.xml", "report.html", RESERVE),
)
"""Every file that a run may write; the suffix `.new` marks unfinished files."""


class RunFolderError(ValueError):
    """A folder cannot be used for a run; the message names the remedy."""


def is_own(folder: Path, note_name: str = RUN_NOTE) -> bool:
    """Whether the folder was made by this program, according to its note."""
    try:
        content = json.loads((folder / note_name).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get(MADE_BY) == MAKER


def refuse_foreign(folder: Path, note_name: str = RUN_NOTE) -> None:
    """Raise RunFolderError if `folder` is no folder, or is not empty and was not made by this program."""
    if folder.exists() and not folder.is_dir():
        raise RunFolderError(f"--out: {folder} is no folder; name a new or an empty one")
    if folder.is_dir() and any(folder.iterdir()) and not is_own(folder, note_name):
        raise RunFolderError(
            f"--out: {folder} is not empty, and no {note_name} in it says that vibrohil made it; "
            "name a new or an empty folder"
        )


def new_folder(name: str) -> Path:
    """Make a new folder under `runs`, named by time and scenario.

    Raises RunFolderError if `runs` cannot be made.
    """
    try:
        RUNS.mkdir(exist_ok=True)
    except OSError as error:
        raise RunFolderError(
            f"{RUNS}/ cannot be made here ({error.strerror}); name a folder with --out"
        ) from error
    stamp, number = time.strftime("%Y%m%d-%H%M%S"), 1
    while True:
        folder = RUNS / (f"{stamp}-{name}" if number == 1 else f"{stamp}-{name}-{number}")
        with suppress(FileExistsError):
            folder.mkdir()
            return folder
        number += 1


@contextmanager
def claimed(name: str, out_dir: Path | None, note_name: str = RUN_NOTE) -> Iterator[Path]:
    """Lock a folder for this process until the end of the block: `out_dir`, or a new one under `runs`.

    The lock ends with the process in any case. Raises RunFolderError if `out_dir` is in use, or is neither
    empty nor made by this program.
    """
    folder = new_folder(name) if out_dir is None else out_dir
    refuse_foreign(folder, note_name)
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RunFolderError(f"--out: {folder} is in use by another run; name another folder") from error
        refuse_foreign(folder, note_name)
        yield folder
    finally:
        os.close(lock)


def is_in_use(folder: Path) -> bool:
    """Whether a process has claimed the folder."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
    return False


def clear(run_dir: Path, keep: tuple[str, ...] = ()) -> None:
    """Remove the files that a run writes, except `keep`."""
    if (run_dir / WARM_UP).is_dir():
        discard(run_dir / WARM_UP)
    for name in set(MADE_BY_A_RUN) - set(keep):
        path = run_dir / name
        if path.is_symlink() and trace.is_elsewhere(path):
            path.resolve().unlink(missing_ok=True)
        path.unlink(missing_ok=True)


def keep_the_log(run_dir: Path) -> None:
    """Remove the traces of a successful run, whose log replaces them."""
    for name in TRACES:
        (run_dir / f"{name}.trace").unlink(missing_ok=True)


def discard(run_dir: Path) -> None:
    """Remove the files of a run, and its folder if it is then empty."""
    clear(run_dir)
    with suppress(OSError):  # it holds other files, or was never made
        run_dir.rmdir()


def reserve(run_dir: Path) -> None:
    """Reserve the disk space for the run's verdict."""
    (run_dir / RESERVE).write_bytes(bytes(RESERVE_BYTES))


def free_reserve(run_dir: Path) -> None:
    """Free the reserved disk space for the verdict."""
    (run_dir / RESERVE).unlink(missing_ok=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically, since other processes may read it."""
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
    unfinished.rename(path)


def note(run_dir: Path, **values: Any) -> None:
    """Add `values` to `run.json`."""
    path = run_dir / RUN_NOTE
    known = json.loads(path.read_text()) if path.exists() else {}
    write_note(path, {**known, **values})


def write_note(path: Path, values: Mapping[str, Any]) -> None:
    """Write the note of a run's or a suite's folder, which marks it as made by this program."""
    write_json(path, {MADE_BY: MAKER, **values})
