"""A counterexample made small: values return to the scenario's own while the check stays broken.

What is left is written as a scenario that names the differences to the searched one; `vibrohil run` repeats
it bit for bit.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from hil.record.new_file import write_anew
from hil.scenario.files import KINDS, beside, locate, read_file, read_scenario
from hil.scenario.scenario import check_scenario
from tools.falsify.evaluations import Evaluations
from tools.falsify.search import Best

DIGITS = range(3, 7)
"""Significant digits to which a value is rounded, the fewest with which the check stays broken."""


def shrink(best: Best, evaluations: Evaluations) -> Best:
    """Return values to the scenario's own, and round the others, as long as the check is broken."""
    values, space = list(best.values), best.space

    def stays_broken(place: int, value: Any) -> bool:
        changed = (*values[:place], value, *values[place + 1 :])
        [result] = evaluations.results(space, [changed], "making the counterexample smaller")
        margin = None if result.why else result.margins[best.check]
        return margin is not None and margin < 0.0

    before: list[Any] = []
    while before != values:
        before = list(values)
        for place, default in enumerate(space.defaults):
            is_used = space.dimensions[place].key in space.changed(values)
            if values[place] != default and (not is_used or stays_broken(place, default)):
                values[place] = default
    for place, (value, default) in enumerate(zip(values, space.defaults, strict=True)):
        if value == default or not isinstance(value, float):
            continue
        rounded = (float(f"{value:.{digits}g}") for digits in DIGITS)
        values[place] = next((one for one in rounded if one == value or stays_broken(place, one)), value)
    [result] = evaluations.results(space, [tuple(values)])
    margin = result.margins[best.check]
    assert margin is not None
    return best._replace(margin=margin, values=tuple(values))


class _OwnKeysLeftError(Exception):
    """A table lacks a key of the other scenario, which a difference cannot say."""


def differences(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of `own` that differ from `base`, as a file with `like` states them."""
    if any(own.get(key) != base.get(key) for key in KINDS):
        return dict(own)
    if set(base) - set(own):
        raise _OwnKeysLeftError
    found: dict[str, Any] = {}
    for key, value in own.items():
        before = base.get(key)
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            if inner := differences(before, value):
                found[key] = inner
        elif value != before:
            found[key] = value
    return found


def write(best: Best, source: str, path: Path) -> Path:
    """Write a run as a scenario with the one check that it breaks, and return its path."""
    space = best.space
    tables = space.tables(best.values)
    place = space.chosen[best.check]
    check = {key: value for key, value in tables["checks"][place].items() if key != "required"}
    tables |= {"checks": [check], "title": f"{best.name} of {space.name} has a margin of {best.margin:.3f}"}
    limit = space.scenario(best.values).checks[place].bounds
    if check_scenario(tables, path.stem).checks[0].bounds != limit:  # another check is a condition of it
        tables["checks"] = [check, *(one for one in space.document["checks"] if one["name"] == "fault")]
    where, _ = locate(source)
    like = read_file(where).get("like")
    base = source if like is None else beside(where, like)
    named = os.path.relpath(base, path.parent) if isinstance(base, Path) or ".toml" in base else base
    content = tables
    try:
        content = {"title": tables["title"], "like": named, **differences(read_scenario(base), tables)}
        write_anew(path, tomli_w.dumps(content))
    except _OwnKeysLeftError:
        write_anew(path, tomli_w.dumps(tables))
    assert read_scenario(path) == tables
    return path
