"""Reading a foreign text: a regular file of bounded size; TOML of bounded length, depth and integers.

All foreign TOML is parsed here, by every package, so this module imports none of them. The limits are checked
before parsing: a parser would use gigabytes and its whole stack for a text that is nested 100,000 deep.
"""

import os
import re
import stat
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

TOMLDecodeError = tomllib.TOMLDecodeError

LARGEST_BYTES = 1 << 20
"""Largest size of a file: four hundred times that of the longest scenario."""
MOST_CHARACTERS = 3 << 19
"""Longest text: a scenario as run, with what it is like written out. The worst such text takes 0.6 GB."""
DEEPEST = 8
"""Most levels of brackets and parts of a dotted key; scenes and scenarios have 4."""
LARGEST_INTEGER = 2**63 - 1
"""Largest magnitude of an integer that TOML requires of a reader."""

# Each alternative consumes its whole text, closed or not, so that no text is scanned twice.
_TEXTS_AND_COMMENTS = re.compile(
    r'"""(?:\\.?|[^\\])*?(?:"""|\Z)'
    r"|'''.*?(?:'''|\Z)"
    r'|"(?:\\.?|[^"\\\n])*+"?'
    r"|'[^'\n]*+'?"
    r"|#[^\n]*+",
    re.DOTALL,
)
_DEEP_KEY = re.compile(rf"(?<![\w-])[\w-]++(?:\s*+\.\s*+[\w-]++){{{DEEPEST}}}")
_BRACKET = re.compile(r"[][{}]")


class RefusalError(Exception):
    """The base of all errors by the input or the machine: the message is for the user; others are defects."""


class TextInputError(RefusalError, ValueError):
    """A file or text that cannot be used; the message states the error, the accepted input and the remedy."""


def read_text(path: Path, what: str, remedy: str) -> str:
    """The UTF-8 text of a regular file of at most LARGEST_BYTES; `what` names it in messages.

    Raises TextInputError. Only regular files are read: a FIFO might wait for ever, and a device has no end.
    What is opened is looked at, because its owner may exchange the file at any time.
    """
    try:
        with open(path, "rb", opener=without_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise TextInputError(f"{what} {str(path)!r} is no regular file; {remedy}")
            content = file.read(LARGEST_BYTES + 1)
        if len(content) > LARGEST_BYTES:
            raise TextInputError(f"{what} {str(path)!r} is larger than {LARGEST_BYTES} bytes; {remedy}")
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise TextInputError(f"{what} {str(path)!r} is no UTF-8 text ({error}); {remedy}") from error
    except IsADirectoryError as error:
        raise TextInputError(f"{what} {str(path)!r} is no regular file; {remedy}") from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise TextInputError(f"{what} {str(path)!r} cannot be read ({reason}); {remedy}") from error
    except ValueError as error:
        if isinstance(error, TextInputError):
            raise
        raise TextInputError(f"{what} {str(path)!r} is no path ({error}); {remedy}") from error


def without_waiting(path: str, flags: int) -> int:
    """The opener of a file that may be a pipe: one to which nobody writes is opened at once."""
    return os.open(path, flags | os.O_NONBLOCK)


def read_toml(path: Path, what: str, remedy: str) -> dict[str, Any]:
    """The tables of a TOML file; raises TextInputError."""
    text = read_text(path, what, remedy)
    try:
        return parse_toml(text)
    except TextInputError as error:
        raise TextInputError(f"{what} {str(path)!r}: {error}; {remedy}") from error
    except TOMLDecodeError as error:
        raise TextInputError(f"{what} {str(path)!r} is not valid TOML: {error}; correct it there") from error


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a text.

    Raises TextInputError beyond the limits, before anything is parsed, and TOMLDecodeError.
    """
    if len(text) > MOST_CHARACTERS:
        raise TextInputError(f"it has {len(text)} characters; wanted {MOST_CHARACTERS} at most")
    refuse_deep(text)
    try:
        tables = tomllib.loads(text)
    except TOMLDecodeError:
        raise
    except ValueError as error:  # Python converts no integer of more than 4300 digits
        raise TextInputError("an integer has more than 64 bits") from error
    refuse_large_integers(tables)
    return tables


def refuse_deep(text: str) -> None:
    """Raise TextInputError if brackets or a dotted key are deeper than DEEPEST."""
    bare = _TEXTS_AND_COMMENTS.sub("s", text)
    deepest = depth = 0
    for bracket in _BRACKET.finditer(bare):
        depth = depth + 1 if bracket[0] in "[{" else max(0, depth - 1)
        deepest = max(deepest, depth)
    if deepest > DEEPEST or _DEEP_KEY.search(bare):
        raise TextInputError(f"its tables are nested more than {DEEPEST} deep")


def refuse_large_integers(tables: dict[str, Any]) -> None:
    """Raise TextInputError if an integer exceeds 64 bits: arithmetic and printing would fail later."""
    left: list[Any] = [tables]
    while left:
        value = left.pop()
        inner: Iterable[Any] = ()
        if isinstance(value, dict):
            inner = value.values()
        elif isinstance(value, list):
            inner = value
        elif isinstance(value, int) and not -LARGEST_INTEGER - 1 <= value <= LARGEST_INTEGER:
            raise TextInputError("an integer has more than 64 bits")
        left.extend(inner)
