"""Damaged files: one sentence with the file, the place of the damage and the readable part."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class DamagedFileError(ValueError):
    """A file of a run, log or suite is unreadable or has invalid content."""


@contextmanager
def reading(path: Path, still_readable: str) -> Iterator[None]:
    """Convert any error while the content of `path` is read to DamagedFileError, caused by that error.

    `still_readable` states the readable part and the remedy. Missing or changed bytes can violate any
    assumption of the reading code, so no list of exceptions would be complete; a panic of Rerun's library
    derives from BaseException.
    """
    try:
        yield
    except DamagedFileError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        where = f"{type(error).__name__}: {error}".splitlines()[0][:300]
        raise DamagedFileError(f"{path} is damaged ({where}); {still_readable}") from error
