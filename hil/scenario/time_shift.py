"""Moves the later part of a script: what begins at or after a given time is delayed.

Commands, faults, the windows of checks and the end of the run move together.
"""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any


def later(document: Mapping[str, Any], since_s: float, by_s: float) -> dict[str, Any]:
    """A copy of a scenario's tables in which every time t ≥ `since_s` of script and checks is t + `by_s`.

    The run becomes longer by `by_s`. Times keep a resolution of 1 µs.
    """
    moved: dict[str, Any] = deepcopy(dict(document))
    script = moved["script"]
    script["duration_s"] = round(script["duration_s"] + by_s, 6)
    lines = [*script.get("commands", []), *script.get("faults", [])]
    for table, key in [
        *((line, "at_s") for line in lines),
        *((check, key) for check in moved.get("checks", []) for key in ("from_s", "to_s")),
    ]:
        if key in table and table[key] >= since_s:
            table[key] = round(table[key] + by_s, 6)
    return moved
