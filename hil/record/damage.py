"""Damaged files and those of other versions: one sentence with the file, the reason and the readable part."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from text_input import RefusalError

LONGEST_REASON = 300
"""Longest part of an error's text, in characters."""


class DamagedFileError(RefusalError, ValueError):
    """A file of a run, log or suite is unreadable or has invalid content."""


CAUSE_UNKNOWN = "is damaged, or of another version"


@contextmanager
def reading(
    path: Path, still_readable: str, cause: Callable[[], str] = lambda: CAUSE_UNKNOWN
) -> Iterator[None]:
    """Convert any error while the content of `path` is read to DamagedFileError, caused by that error.

    `still_readable` states the readable part and the remedy, `cause` what is wrong with the file. Missing or
    changed bytes can violate any assumption of the reading code, so no list of exceptions would be complete;
    a panic of Rerun's library derives from BaseException.
    """
    try:
        yield
    except DamagedFileError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise DamagedFileError(f"{path} {cause()} ({reason_of(error)}); {still_readable}") from error


def reason_of(error: BaseException) -> str:
    """What an error while a file is read says about it, in a line.

    >>> reason_of(ValueError("a record has no time"))
    'a record has no time'
    """
    kind, text = type(error).__name__, (str(error).splitlines() or [""])[0][:LONGEST_REASON]
    if isinstance(error, AttributeError | TypeError):
        return f"a value of another type than wanted: {text}"
    return text if isinstance(error, ValueError) and text else f"{kind}: {text}"
