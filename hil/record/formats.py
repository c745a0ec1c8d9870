"""The number of the format of each file that a user may keep; docs/formats.md lists their changes."""

from collections.abc import Mapping
from typing import Any

SCENARIO = PARAMETERS = VERDICT = SUITE = TRACE = 1
KEY = "format"


class FormatError(ValueError):
    """A file has a format that this version does not read."""


def refuse_other_format(what: str, content: Mapping[str, Any], known: int, remedy: str) -> None:
    """Raise FormatError unless `content` has this format; a file without the key has format 1.

    >>> refuse_other_format("a.toml", {"format": 2}, 1, "give another")
    Traceback (most recent call last):
    hil.record.formats.FormatError: a.toml has format 2, and this version of vibrohil reads 1; give another
    """
    if content.get(KEY, 1) != known:
        found = f"format {content[KEY]!r}, and this version of vibrohil reads {known}"
        raise FormatError(f"{what} has {found}; {remedy}")
