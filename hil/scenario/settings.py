"""Changes to a scene, the firmware's parameters or a script by dotted keys: `--set`, or a Python mapping."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

from plant_sim.text_input import DEEPEST, TextInputError, parse_toml

Settings = str | Sequence[str] | Mapping[str, Any]
"""One or more texts `KEY=VALUE` with TOML values, or a mapping from dotted keys to values."""


class SettingError(TextInputError):
    """A `--set` cannot be read or has no valid key."""


def parse_value(text: str) -> Any:
    """Parse a TOML value: 1.3, true, "word", [1, 2]; a bare word is a string. Raises TextInputError."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def keys_and_values(settings: Settings) -> Iterator[tuple[str, Any]]:
    """The dotted key and the value of each setting."""
    if isinstance(settings, Mapping):
        yield from settings.items()
        return
    for setting in [settings] if isinstance(settings, str) else settings:
        path, separator, text = setting.partition("=")
        if not separator:
            raise SettingError(
                f"--set {setting!r} is not KEY=VALUE with a dotted key, e.g. scene.drive.ratio=1.3"
            )
        try:
            yield path.strip(), parse_value(text.strip())
        except TextInputError as error:
            raise SettingError(f"--set {setting!r}: {error}; give a plain value") from error


def as_texts(settings: Settings) -> list[str]:
    """The settings as texts KEY=VALUE."""
    return [f"{key}={value}" for key, value in keys_and_values(settings)]


def apply_settings(document: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """A copy of `document` with each value of `settings` in its place.

    The first word of a key must be one of the document's own tables (such as scene, firmware, script);
    tables below it are made as needed.
    """
    changed: dict[str, Any] = deepcopy(dict(document))
    for setting, value in keys_and_values(settings):
        keys = setting.split(".")
        if len(keys) < 2 or not all(keys):
            raise SettingError(
                f"--set {setting!r} is not KEY=VALUE with a dotted key, e.g. scene.drive.ratio=1.3"
            )
        if len(keys) > DEEPEST:
            raise SettingError(f"--set {setting!r} has a key of more than {DEEPEST} parts; none is so deep")
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
        table[keys[-1]] = deepcopy(value)
    return changed
