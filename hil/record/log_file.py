"""A log as a file: written as a whole or not at all, recognised if it is incomplete, and repaired."""

import errno
import mmap
import os
import shutil
import struct
import warnings
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from hil.record.new_file import made_anew
from hil.record.rerun_program import RerunError, rerun

MAGIC = b"RRF2"
"""First bytes of a log."""
ROOM_BYTES = 64 << 20
"""Room on the disk that a log must have before each of its pieces, which is at most two thirds of it."""


LARGEST_SHARE = 100
"""Largest size of a log unpacked over its own; that of a run at rest is some forty."""
HEADER_BYTES = 12
MESSAGE = struct.Struct("<QQ")
"""Kind and length of a message."""
END, DATA = 0, 2
"""Kinds of messages: the last one, and those that hold data."""
MOST_FOOTER_BYTES = 64
"""What follows the last message, and more; another recording would follow there."""
UNPACKED_SIZE = 3
"""The field of a message with the size of its data once unpacked."""


def begins_as_log(path: Path) -> bool:
    """Whether a file begins like a log; Rerun's program would read any other file into memory as a whole."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def refuse_far_larger(path: Path) -> None:
    """Raise RerunError if a log's messages unpack to far more than its size, before any is unpacked.

    A message is its kind and length, then fields in the format of protocol buffers. What is none, such as the
    end of a cut log, is left to Rerun.
    """
    stored = path.stat().st_size
    most = LARGEST_SHARE * stored + ROOM_BYTES
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        place, unpacked = HEADER_BYTES, 0
        while place + MESSAGE.size <= stored and unpacked <= most:
            kind, length = MESSAGE.unpack_from(content, place)
            place += MESSAGE.size
            if kind == END:
                if stored - place - length > MOST_FOOTER_BYTES:
                    raise RerunError(f"{path} goes on behind its end; wanted one recording")
                break
            if kind == DATA:
                with suppress(IndexError):
                    unpacked += number_in(content, place, min(place + length, stored), UNPACKED_SIZE)
            place += length
    if unpacked > most:
        raise RerunError(f"{path} has {stored} bytes, which unpack to {unpacked}; a run makes no such log")


def number_in(content: mmap.mmap, place: int, end: int, wanted: int) -> int:
    """The last value of an integer field of a message in the format of protocol buffers; 0 without it."""

    def varint() -> int:
        nonlocal place
        value = shift = 0
        while True:
            byte = content[place]
            value |= (byte & 0x7F) << shift
            place, shift = place + 1, shift + 7
            if byte < 0x80 or shift > 63:
                return value

    found = 0
    while place < end:
        field, wire = divmod(varint(), 8)
        if wire == 0:
            value = varint()
            found = value if field == wanted else found
        else:
            size = {1: 8, 5: 4}.get(wire) or varint()
            place += size
    return found


def is_whole(path: Path) -> bool:
    """Whether a log holds a recording that can be read from its first message to its footer."""
    if not begins_as_log(path):
        return False
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
    if begins_as_log(path):
        refuse_far_larger(path)
    if is_whole(path):
        return False
    if not begins_as_log(path):
        raise RerunError(
            f"{path} is no Rerun log: its first bytes are not those of one; rebuild it from the traces"
        )
    mended = made_anew(path.with_name(f"{path.name}.mended"))
    outcome = rerun(["rrd", "optimize", "--continue-on-error", path, "-o", mended])
    if outcome.returncode != 0 or not is_whole(mended):
        mended.unlink(missing_ok=True)
        reason = outcome.stderr.strip() if outcome.returncode else "it ends before its recording begins"
        raise RerunError(f"{path} is cut and cannot be mended ({reason}); rebuild it from the traces")
    mended.rename(path)
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
