"""A log as a file: written as a whole or not at all, recognised if it is incomplete, and repaired."""

import errno
import mmap
import os
import shutil
import warnings
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from hil.record.new_file import made_anew
from hil.record.rerun_program import RerunError, rerun
from hil.record.rrd.arrow_extent import ExtentError, extent_bytes
from hil.record.rrd.messages import (
    DATA,
    END,
    Packed,
    data_of,
    messages_of,
    refuse_other_places,
    tables_of_places,
)

MAGIC = b"RRF2"
"""First bytes of a log."""
ROOM_BYTES = 64 << 20
"""Room on the disk that a log must have before each of its pieces, which is at most two thirds of it."""


LARGEST_SHARE = 100
"""Largest size of a log unpacked over its own; that of a run at rest is some forty."""


def begins_as_log(path: Path) -> bool:
    """Whether a file begins like a log; Rerun's program would read any other file into memory as a whole."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def refuse_far_larger(path: Path) -> None:
    """Raise RerunError if Rerun would unpack a log to far more than its size, before it unpacks anything.

    Each message is unpacked alone, and its memory follows from the headers of its arrays. What is not whole,
    such as the last message of a cut log, is left to Rerun.
    """
    stored = path.stat().st_size
    most = LARGEST_SHARE * stored + ROOM_BYTES
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        try:
            taken = taken_bytes(content, most)
        except ExtentError as error:
            raise RerunError(f"{path} holds {error}; a run makes no such log") from error
    if taken > most:
        raise RerunError(f"{path} has {stored} bytes, which unpack to {taken}; a run makes no such log")


def taken_bytes(content: mmap.mmap, most: int) -> int:
    """The memory that the messages of a log and its footer take, or the first sum that exceeds `most`."""
    data: dict[int, int] = {}
    taken, end = 0, None
    for message in messages_of(content):
        if message.kind == DATA:
            data[message.place] = message.length
            taken += extent_within(data_of(content, message), most - taken)
        elif message.kind == END:
            end = message
        if taken > most:
            return taken
    for table in tables_of_places(content, end):
        taken += extent_within(table, most - taken)
        if taken > most:
            return taken
        refuse_other_places(table.unpacked(), data)
    return taken


def extent_within(packed: Packed, most: int) -> int:
    """The memory that an Arrow stream takes; if it says to have more bytes than `most`, these."""
    return packed.size if packed.size > most else extent_bytes(packed.unpacked())


def is_whole(path: Path) -> bool:
    """Whether a log holds a recording that can be read from its first message to its footer.

    Raises RerunError before it reads one that unpacks to far more than its size.
    """
    if not begins_as_log(path):
        return False
    refuse_far_larger(path)
    try:
        with warnings.catch_warnings(action="ignore", category=RerunWarning):  # of a log without a footer
            reader = RrdReader(path)
            if not reader.recordings():
                return False
            deque(reader.store().stream(), maxlen=0)
    except RuntimeError:
        return False
    return True


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
    mended = made_anew(path.with_name(f"{path.name}.mended"))
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
    unfinished = made_anew(path.with_name(f"{path.name}.new"))
    try:
        yield unfinished
        if not is_whole(unfinished):
            raise RerunError(f"{path} is not written: the disk took only a part of it; make room for all")
        unfinished.rename(path)
    finally:
        unfinished.unlink(missing_ok=True)
