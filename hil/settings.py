"""`--set KEY=VALUE`: dotted changes to a scene, the firmware's parameters or a script, as TOML values."""

import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any


class SettingError(ValueError):
    """A `--set` that names nothing or cannot be read."""


def parse_value(text: str) -> Any:
    """`text` as a TOML value: 1.3, true, "word", [1, 2]; a bare word is a string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def apply_settings(document: Mapping[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """A copy of `document` with each `a.b.c=value` of `settings` in place.

    The first word must be one of the document's own tables (such as scene, firmware, script); tables below
    it are made as needed.
    """
    changed: dict[str, Any] = deepcopy(dict(document))
    for setting in settings:
        path, separator, text = setting.partition("=")
        keys = path.strip().split(".")
        if not separator or len(keys) < 2 or not all(keys):
            raise SettingError(
                f"--set {setting!r} is not KEY=VALUE with a dotted key, e.g. scene.drive.ratio=1.3"
            )
        if keys[0] not in changed:
            known = ", ".join(f"{key}." for key in changed)
            raise SettingError(f"--set {setting!r} starts with {keys[0]!r}; wanted one of {known}")
        table = changed
        for depth, key in enumerate(keys[:-1]):
            table = table.setdefault(key, {})
            if not isinstance(table, dict):
                raise SettingError(
                    f"--set {setting!r}: {'.'.join(keys[: depth + 1])} is a value, not a table"
                )
        table[keys[-1]] = parse_value(text.strip())
    return changed
