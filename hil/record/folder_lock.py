"""The lock of a folder, which one process holds until its block, or the process itself, ends."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
