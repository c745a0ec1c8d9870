"""The run folder before and during a run; hil.runs.verdict judges its content afterwards.

A run owns its folder: `claimed` makes a new folder, or takes one that is empty or was made by a run according
to its `run.json`, and locks it. Only files that a run writes are ever removed.
"""

import fcntl
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from hil.record.new_file import MOST_NOTE_BYTES, foreign_link_on, is_foreign, is_regular, write_anew
from hil.record.traces import trace
from hil.run_files import MADE_BY_A_RUN, TRACE_FILES, RunFile
from text_input import RefusalError


class FolderInUseError(Exception):
    """Another process holds the folder's lock."""


@contextmanager
def locked(folder: Path, shared: bool = False) -> Iterator[None]:
    """Hold the lock of a folder; `shared`: with others who only look at it.

    Raises FolderInUseError if another process holds it for itself; those who look are waited for.
    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        while not take(lock, fcntl.LOCK_SH if shared else fcntl.LOCK_EX):
            if shared or not take(lock, fcntl.LOCK_SH):
                raise FolderInUseError(f"{folder} is in use by another process")
        yield
    finally:
        os.close(lock)


def take(lock: int, kind: int) -> bool:
    """Lock an open folder, without waiting; False if another process's lock forbids it."""
    try:
        fcntl.flock(lock, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def is_in_use(folder: Path) -> bool:
    """Whether a process holds the folder's lock."""
    try:
        with locked(folder, shared=True):
            return False
    except FolderInUseError:
        return True


RUNS = Path("runs")
SUITE_NOTE = "suite.json"
RESULTS = (RunFile.VERDICT, SUITE_NOTE)
RESERVE_BYTES = 2 << 20
"""Disk space reserved for verdict, JUnit and outcome in case a run fills the disk."""
MADE_BY = "made_by"
"""Key in a folder's note that marks the folder as made by this program."""
MAKER = "vibrohil"

MADE_BY_A_SUITE = (SUITE_NOTE, f"{SUITE_NOTE}.new", RunFile.JUNIT, "index.html")
"""Every file that a suite itself may write."""
MOST_RESULT_BYTES = 32 << 20
"""Size of the largest result of a run, which lists every impact, or of a suite."""
MOST_HOLES_BYTES = 64 << 20
"""Size up to which a file may be all holes; a trace grows by such pieces."""
OTHERS_WRITE = 0o022
"""The bits of a mode that let group and others write."""
FOLDER_MODE = 0o777 & ~OTHERS_WRITE
LATEST_S = 9e9
"""Latest time at which a run may say that it began: the year 2255."""
BLOCK_BYTES = 512
"""Unit of `st_blocks`."""
LARGEST_SHARE_OF_HOLES = 100
"""Largest size of a file over its size on the disk; a file system that compresses stays below."""


class RunFolderError(RefusalError, ValueError):
    """A folder cannot be used for a run; the message names the remedy."""


def refuse_large_note(path: Path) -> None:
    """Raise RunFolderError for a JSON or TOML file that is too large to be read."""
    size, most = path.stat().st_size, MOST_RESULT_BYTES if path.name in RESULTS else MOST_NOTE_BYTES
    if size > most:
        raise RunFolderError(f"{path} has {size} bytes; wanted {most} at most")


def read_note(path: Path) -> dict[str, Any]:
    """A JSON object in a run folder; empty for a file that is none or too large, a link, pipe or device."""
    if not is_regular(path):
        return {}
    try:
        refuse_large_note(path)
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def begun_s(run_dir: Path) -> float:
    """The time at which a run began by its run.json; without it, when that was last written."""
    place = run_dir / RunFile.NOTE
    stated = read_note(place).get("begun_s")
    if isinstance(stated, int | float) and 0.0 <= stated < LATEST_S:
        return float(stated)
    return place.lstat().st_mtime


def is_own(folder: Path, note_name: str = RunFile.NOTE) -> bool:
    """Whether the folder was made by this program, according to its note."""
    return read_note(folder / note_name).get(MADE_BY) == MAKER


def is_written_by_oneself(*places: Path) -> bool:
    """Whether these files and folders belong to this user, and no other may write them."""
    found = [place.lstat() for place in places]
    return all(one.st_uid == os.geteuid() and not one.st_mode & OTHERS_WRITE for one in found)


def open_taken_over(path: Path, remedy: str) -> BinaryIO:
    """A file with results that are continued, opened to read; FileNotFoundError if there is none.

    Raises RunFolderError for a link, or if another user may have written the file or its folder.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise RunFolderError(f"{path} is no file of a result ({error.strerror}); remove it") from error
    file = os.fdopen(descriptor, "rb")
    for place, found in ((path.parent, path.parent.stat()), (path, os.fstat(descriptor))):
        if found.st_uid != os.geteuid() or found.st_mode & OTHERS_WRITE:
            file.close()
            raise RunFolderError(
                f"{place} has results that another user may have written (owner {found.st_uid}, mode "
                f"{found.st_mode & 0o777:o}); {remedy}"
            )
    return file


def refuse_irregular(run_dir: Path) -> None:
    """Raise RunFolderError if a file of a run is a link, a pipe or a device, or is far too large.

    A file that is mostly holes takes no space to pass on, and has no end for its reader.
    """
    for name in MADE_BY_A_RUN:
        path = run_dir / name
        if not os.path.lexists(path) or trace.is_elsewhere(path):
            continue
        if not is_regular(path):
            raise RunFolderError(
                f"{path} is no file but a link, folder, pipe or device; a run makes only files"
            )
        found = path.stat()
        if path.suffix in (".json", ".toml"):
            refuse_large_note(path)
        if found.st_size > LARGEST_SHARE_OF_HOLES * BLOCK_BYTES * found.st_blocks + MOST_HOLES_BYTES:
            raise RunFolderError(
                f"{path} has {found.st_size} bytes, and {BLOCK_BYTES * found.st_blocks} on the disk; "
                "a run makes no such holes"
            )


def refuse_foreign(folder: Path, note_name: str = RunFile.NOTE) -> None:
    """Raise RunFolderError if `folder` is no folder, or is not empty and was not made by this program."""
    if folder.is_symlink() and not folder.exists():
        raise RunFolderError(
            f"--out: {folder} is a link to {os.readlink(folder)}, which does not exist; name another folder"
        )
    if folder.exists() and not folder.is_dir():
        raise RunFolderError(f"--out: {folder} is no folder; name a new or an empty one")
    if folder.is_dir() and any(folder.iterdir()) and not is_own(folder, note_name):
        raise RunFolderError(
            f"--out: {folder} is not empty, and no {note_name} in it says that vibrohil made it; "
            "name a new or an empty folder"
        )
    for name in (*MADE_BY_A_RUN, *MADE_BY_A_SUITE):
        if (folder / name).is_dir() and not (folder / name).is_symlink():
            raise RunFolderError(
                f"--out: {folder / name} is a folder in the place of a file; remove it, or name another"
            )


def refuse_links(folder: Path, within: Path) -> None:
    """Raise RunFolderError if `folder`, or one between it and `within`, is a link: it may lead anywhere."""
    for one in (folder, *folder.parents):
        if one == within:
            return
        if one.is_symlink():
            raise RunFolderError(
                f"--out: {one} is a link to {os.readlink(one)}; remove it, or name another folder"
            )


def new_folder(name: str) -> Path:
    """Make a new folder under `runs`, named by time and scenario.

    Raises RunFolderError if `runs` cannot be made.
    """
    if link := foreign_link_on(RUNS):
        raise RunFolderError(
            f"{link} is another user's link to {os.readlink(link)}; name a folder with --out"
        )
    try:
        RUNS.mkdir(FOLDER_MODE, exist_ok=True)
    except OSError as error:
        raise RunFolderError(
            f"{RUNS}/ cannot be made here ({error.strerror}); name a folder with --out"
        ) from error
    stamp, number = time.strftime("%Y%m%d-%H%M%S"), 1
    while True:
        folder = RUNS / (f"{stamp}-{name}" if number == 1 else f"{stamp}-{name}-{number}")
        with suppress(FileExistsError):
            folder.mkdir(FOLDER_MODE)
            return folder
        number += 1


@contextmanager
def written_by_oneself() -> Iterator[None]:
    """In this block new files and folders have the umask's modes, but no other user may write them."""
    before = os.umask(OTHERS_WRITE)
    os.umask(before | OTHERS_WRITE)
    try:
        yield
    finally:
        os.umask(before)


@contextmanager
def claimed(name: str, out_dir: Path | None, note_name: str = RunFile.NOTE) -> Iterator[Path]:
    """Lock a folder for this process until the end of the block: `out_dir`, or a new one under `runs`.

    Yields its absolute path, so that it remains the same folder if the working directory changes.

    The lock ends with the process in any case. Raises RunFolderError if `out_dir` is in use, or is neither
    empty nor made by this program.
    """
    folder = (new_folder(name) if out_dir is None else out_dir).absolute()
    refuse_foreign(folder, note_name)
    with ExitStack() as stack:
        stack.enter_context(written_by_oneself())
        folder.mkdir(parents=True, exist_ok=True)
        try:
            stack.enter_context(locked(folder))
        except FolderInUseError as error:
            raise RunFolderError(f"--out: {folder} is in use by another run; name another folder") from error
        refuse_foreign(folder, note_name)
        try:
            yield folder
        except FileNotFoundError as error:
            if folder.is_dir():
                raise
            raise RunFolderError(
                f"--out: {folder} was removed by another program while it was written; run the command again"
            ) from error


def discard_unused(run_dir: Path, below: Path) -> bool:
    """Remove a run's files, unless they are foreign, or it or a suite below `below` is in progress."""
    if is_foreign(run_dir) or any(
        is_in_use(folder) for folder in run_dir.parents if folder.is_relative_to(below)
    ):
        return False
    try:
        with locked(run_dir):
            discard(run_dir)
    except FolderInUseError:
        return False
    return True


def clear(run_dir: Path, keep: tuple[str, ...] = ()) -> None:
    """Remove the files that a run writes, except `keep`."""
    for name in set(MADE_BY_A_RUN) - set(keep):
        path = run_dir / name
        if path.is_symlink() and trace.is_elsewhere(path):
            path.resolve().unlink(missing_ok=True)
        with suppress(IsADirectoryError):  # no run has made it
            path.unlink(missing_ok=True)


def keep_the_log(run_dir: Path) -> None:
    """Remove the traces of a successful run, whose log replaces them."""
    for name in TRACE_FILES:
        (run_dir / name).unlink(missing_ok=True)


def discard(run_dir: Path) -> None:
    """Remove the files of a run, and its folder if it is then empty."""
    clear(run_dir)
    with suppress(OSError):  # it holds other files, or was never made
        run_dir.rmdir()


def reserve(run_dir: Path) -> None:
    """Reserve the disk space for the run's verdict."""
    write_anew(run_dir / RunFile.RESERVE, bytes(RESERVE_BYTES))


def free_reserve(run_dir: Path) -> None:
    """Free the reserved disk space for the verdict."""
    (run_dir / RunFile.RESERVE).unlink(missing_ok=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically, since other processes may read it."""
    unfinished = path.with_name(f"{path.name}.new")
    write_anew(unfinished, json.dumps(content, indent=2, allow_nan=False) + "\n")
    unfinished.rename(path)


def note(run_dir: Path, **values: Any) -> dict[str, Any]:
    """Add `values` to `run.json`; return its content."""
    path = run_dir / RunFile.NOTE
    known = json.loads(path.read_text()) if path.exists() else {}
    write_note(path, known | values)
    return known | values


def write_note(path: Path, values: Mapping[str, Any]) -> None:
    """Write the note of a run's or a suite's folder, which marks it as made by this program."""
    write_json(path, {MADE_BY: MAKER, **values})
