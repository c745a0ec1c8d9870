"""What the files that a user may keep share: the number of a format, and JSON's types for values.

docs/formats.md lists the changes of each format.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

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


def plain(value: Any, finite: bool = True) -> Any:
    """`value` in JSON's own types: arrays become lists, paths texts, if `finite` NaN and infinities null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item, finite) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), finite)
    if isinstance(value, list | tuple):
        return [plain(item, finite) for item in value]
    if isinstance(value, Path):
        return str(value)
    if finite and isinstance(value, float) and not math.isfinite(value):
        return None
    return value
