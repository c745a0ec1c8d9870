"""A log as a file: written as a whole or not at all, recognised if it is incomplete, and repaired."""

import errno
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from hil.record.new_file import make_anew
from hil.record.rrd.rerun_program import RerunError, rerun
from hil.record.rrd.unpacked_size import count_chunks

MAGIC = b"RRF2"
"""First bytes of a log."""
ROOM_BYTES = 64 << 20
"""Room on the disk that a log must have before each of its pieces, which is at most two thirds of it."""


def begins_as_log(path: Path) -> bool:
    """Whether a file begins like a log; Rerun's program would read any other file into memory as a whole."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def is_whole(path: Path) -> bool:
    """Whether a log holds a recording that can be read from its first message to its footer.

    Raises RerunError for a log of several recordings, and for one that unpacks to more than a run's.
    """
    if not begins_as_log(path):
        return False
    chunks = count_chunks(path)
    try:
        with warnings.catch_warnings(action="ignore", category=RerunWarning):  # of a log without a footer
            reader = RrdReader(path)
            recordings = len(reader.recordings())
            if recordings == 1:
                stream = reader.store().stream()
                if sum(1 for _ in islice(stream, chunks + 1)) > chunks:  # the footer lists one several times
                    return False
    except RuntimeError:
        return False
    if recordings > 1:
        raise RerunError(f"{path} holds {recordings} recordings; a run makes one")
    return recordings == 1


def repair(path: Path) -> bool:
    """Repair a log that is incomplete after a kill, in place; returns whether a repair was needed.

    An incomplete log lacks its footer and may end within a message. Raises `RerunError` if it is unreadable
    or ends before its recording begins.
    """
    if is_whole(path):
        return False
    if not begins_as_log(path):
        raise RerunError(
            f"{path} is no Rerun log: its first bytes are not those of one; rebuild it from the traces"
        )
    mended = make_anew(path.with_name(f"{path.name}.mended"))
    try:
        outcome = rerun(["rrd", "optimize", "--continue-on-error", path, "-o", mended])
        if outcome.returncode != 0 or not is_whole(mended):
            reason = outcome.stderr.strip() if outcome.returncode else "it ends before its recording begins"
            raise RerunError(f"{path} is cut and cannot be mended ({reason}); rebuild it from the traces")
        mended.rename(path)
    finally:
        mended.unlink(missing_ok=True)
    return True


def refuse_full_disk(path: Path, needed_bytes: int = ROOM_BYTES) -> None:
    """Raise OSError if a file at `path` has no room; a recording that meets a full disk may wait for ever."""
    free_bytes = shutil.disk_usage(path.parent).free
    if free_bytes < needed_bytes:
        sizes = f"{free_bytes / 1e6:.0f} MB free, wanted {needed_bytes / 1e6:.0f} MB"
        raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)}: {sizes}", str(path))


@contextmanager
def written_whole(path: Path, needed_bytes: int = ROOM_BYTES) -> Iterator[Path]:
    """Give the path of an unfinished file for a log; after the block the log gets its name `path`.

    Raises OSError if there is no room for `needed_bytes`, `RerunError` if only a part was written.
    """
    refuse_full_disk(path, needed_bytes)
    unfinished = make_anew(path.with_name(f"{path.name}.new"))
    try:
        yield unfinished
        if not is_whole(unfinished):
            raise RerunError(f"{path} is not written: the disk took only a part of it; make room for all")
        unfinished.rename(path)
    finally:
        unfinished.unlink(missing_ok=True)
