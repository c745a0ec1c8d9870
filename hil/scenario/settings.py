"""Changes to a scene, the firmware's parameters or a script by dotted keys: `--set`, or a Python mapping."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from firmware_py.interface.enums import ParameterTier
from firmware_py.interface.parameter_table import TABLE
from plant_sim.validation_messages import nearest
from text_input import DEEPEST, TextInputError, TOMLDecodeError, parse_toml

Settings = str | Sequence[str] | Mapping[str, Any]
"""One or more texts `KEY=VALUE` with TOML values, or a mapping from dotted keys to values."""


MODULE = "module."
"""Beginning of a key that stands for the module's truth and the firmware's nominal parameter together."""
MODULE_PARAMETERS = [one.name for one in TABLE if one.tier is ParameterTier.MODULE]


class SettingError(TextInputError):
    """A `--set` cannot be read or has no valid key."""


def parse_value(text: str) -> Any:
    """Parse a TOML value: 1.3, true, "word", [1, 2]; a bare word is a string. Raises TextInputError."""
    try:
        document = parse_toml(f"value = {text}")
    except TOMLDecodeError:
        document = {"value": text}
    if len(document) > 1 or (document["value"] == text and "\n" in text):
        raise TextInputError("it has a second line; give each setting by itself")
    return document["value"]


def keys_and_values(settings: Settings) -> Iterator[tuple[str, Any]]:
    """The dotted key and the value of each setting; raises SettingError for anything but `Settings`."""
    if isinstance(settings, bytes) or not isinstance(settings, Iterable):
        raise SettingError(f"set = {settings!r}: wanted texts KEY=VALUE, or a mapping from keys to values")
    if isinstance(settings, Mapping):
        for key, value in settings.items():
            yield as_text(key), toml_value(key, value)
        return
    for setting in [settings] if isinstance(settings, str) else settings:
        path, separator, text = as_text(setting).partition("=")
        if not separator:
            raise SettingError(
                f"--set {setting!r} is not KEY=VALUE with a dotted key, e.g. scene.drive.ratio=1.3"
            )
        try:
            yield path.strip(), parse_value(text.strip())
        except TextInputError as error:
            raise SettingError(f"--set {setting!r}: {error}; give a plain value") from error


def as_text(setting: object) -> str:
    """A setting or its key; raises SettingError unless it is a text."""
    if not isinstance(setting, str):
        raise SettingError(f"set has {setting!r}: wanted a text with a dotted key, e.g. scene.drive.ratio")
    return setting


def toml_value(key: str, value: Any) -> Any:
    """A Python value as TOML has it, numpy's numbers and arrays too; raises SettingError for others."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {name: toml_value(f"{key}.{name}", inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [toml_value(key, inner) for inner in value]
    if not isinstance(value, bool | int | float | str):
        raise SettingError(
            f"set {key!r} = {value!r}: wanted a number, a text, true or false, or a list or table of them"
        )
    return value


def as_texts(settings: Settings) -> list[str]:
    """The settings as texts KEY=VALUE, as `--set` takes them: TOML values, and texts as bare words."""
    return [
        f"{key}={value if isinstance(value, str) else toml_text(value)}"
        for key, value in keys_and_values(settings)
    ]


def toml_text(value: Any) -> str:
    """A value as TOML in one line.

    >>> toml_text([{"at_s": 0.5, "request": "run"}, True])
    '[{at_s = 0.5, request = "run"}, true]'
    """
    if isinstance(value, Mapping):
        pairs = (f"{toml_key(name)} = {toml_text(inner)}" for name, inner in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml_text, value))}]"
    # Texts, true and false look alike in JSON and TOML; infinite numbers do not.
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else str(value)


def toml_key(name: str) -> str:
    """A key of a TOML table, in quotation marks unless it is a bare word."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def split_key(key: str) -> list[str]:
    """The parts of a dotted key; raises TextInputError."""
    parts = key.split(".")
    if not all(parts):
        raise TextInputError(f"{key!r} is no dotted key, e.g. scene.drive.ratio")
    if len(parts) > DEEPEST:
        raise TextInputError(f"{key!r} has more than {DEEPEST} parts; no key is so deep")
    return parts


def put(document: dict[str, Any], keys: Sequence[str], value: Any) -> None:
    """Set the value at the parts of a dotted key; raises TextInputError.

    Missing tables are made. A table of a list has its place, from 0, as key.
    """
    place: Any = document
    for depth, key in enumerate(keys):
        here = ".".join(keys[: depth + 1])
        is_last = depth == len(keys) - 1
        if isinstance(place, list):
            if key not in map(str, range(len(place))):
                raise TextInputError(f"{here}: the list has {len(place)} entries; give a place, from 0")
            if is_last:
                place[int(key)] = deepcopy(value)
            else:
                place = place[int(key)]
        elif is_last:
            place[key] = deepcopy(value)
        else:
            place = place.setdefault(key, {})
        if not is_last and not isinstance(place, dict | list):
            raise TextInputError(f"{here} is a value, not a table")


def of_the_module(key: str) -> tuple[str, str]:
    """The keys of the truth and of the nominal parameter behind `module.KEY`; raises SettingError.

    >>> of_the_module("module.striker.mass_kg")
    ('scene.striker.mass_kg', 'firmware.striker.mass_kg')
    """
    name = key.removeprefix(MODULE)
    if name not in MODULE_PARAMETERS:
        near = nearest(name, MODULE_PARAMETERS, "docs/reference/parameters.md lists those of the module")
        raise SettingError(f"--set {key!r}: the firmware has no such nominal parameter of the module; {near}")
    return f"scene.{name}", f"firmware.{name}"


def apply_settings(document: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """A copy of `document` with each value of `settings` in its place.

    The first word of a key must be one of the document's own tables (such as scene, firmware, script);
    tables below it are made as needed, and a number is a place in a list, from 0. `module.KEY` sets the same
    key of the scene and of the firmware's nominal parameters.
    """
    changed: dict[str, Any] = deepcopy(dict(document))
    both = {"scene", "firmware"} <= set(changed)
    single = (
        (key, value)
        for setting, value in keys_and_values(settings)
        for key in (of_the_module(setting) if both and setting.startswith(MODULE) else (setting,))
    )
    for setting, value in single:
        first, _, rest = setting.partition(".")
        if not (first and rest):
            raise SettingError(
                f"--set {setting!r} is not KEY=VALUE with a dotted key, e.g. scene.drive.ratio=1.3"
            )
        if first not in changed:
            known = ", ".join(f"{key}." for key, part in changed.items() if isinstance(part, dict | list))
            known += f", {MODULE}" if both else ""
            raise SettingError(f"--set {setting!r} starts with {first!r}; wanted one of {known}")
        try:
            put(changed, split_key(setting), value)
        except TextInputError as error:
            raise SettingError(f"--set: {error}") from error
    return changed
