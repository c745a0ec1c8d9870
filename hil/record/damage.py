"""Damaged files: one sentence with the file, the place of the damage and the readable part."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class DamagedFileError(ValueError):
    """A file of a run, log or suite that cannot be read, or whose content makes no sense."""


@contextmanager
def reading(path: Path, still_readable: str) -> Iterator[None]:
    """Turn whatever fails while the content of `path` is read into DamagedFileError, caused by the failure.

    `still_readable` says what is left and what to do. Bytes that were cut off or turned over can break any
    rule of the code that reads them, so that no list of exceptions would be complete; a panic of Rerun's
    library derives from BaseException.
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
