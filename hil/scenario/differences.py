"""What a scenario's file leaves out: it can name another scenario, sets of checks, and a grid of cases.

These functions turn the tables of such a file into those of a complete scenario, in this order: the other
scenario (`like`), the values of the case (`vary`), the sets of checks.
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import Field

from hil.scenario.search import MOST_KEYS, SearchTable
from hil.scenario.settings import put, split_key
from plant_sim.tables.table import Table
from plant_sim.validation_messages import nearest
from text_input import TextInputError, read_toml

CHECK_SETS = Path(__file__).with_name("check_sets.toml")
KINDS = ("law", "model")
"""Keys that name the kind of a part: a table with another kind replaces that of the other scenario."""
LARGEST_GRID = 1000
"""Most cases of one file."""
MOST_VALUES = 100_000
"""Most values of all cases of one file: each case has every key."""
NAME = re.compile(r"\w[\w.+-]{0,149}")
"""Names of cases, which become names of folders."""


class FileTable(Table):
    """Keys of a scenario's file beside its tables; the complete scenario has none of them."""

    format: int = Field(default=1, description="number of the file's format; this version reads 1")
    like: str | None = Field(
        default=None,
        description="another scenario, by its name or its file beside this one, from which this file states "
        "the differences; that scenario must not have `like` itself",
    )
    append: list[str] = Field(
        default=[],
        description="dotted keys of lists, such as `script.commands`, that continue those of `like` instead "
        "of replacing them",
    )
    vary: list[dict[str, Any]] = Field(
        default=[],
        description="the tables [[vary]]: each gives keys of the scenario a list with one value for each "
        "case; several tables give all combinations; the key `name` gives the names of the cases",
    )
    search: list[SearchTable] = Field(
        default=[], max_length=MOST_KEYS, description="the tables [[search]] of `vibrohil falsify`"
    )


def apply_differences(
    base: Mapping[str, Any], own: Mapping[str, Any], append: Collection[str] = (), above: str = ""
) -> dict[str, Any]:
    """The tables of `base` with the differences that `own` states.

    Tables are merged, unless they state another law or model; all other values replace those of `base`, and
    lists in `append` continue them. `above`: the dotted key of these tables, with a final dot.
    """
    if any(key in own and own[key] != base.get(key) for key in KINDS):
        return dict(own)
    merged = dict(base)
    for key, value in own.items():
        before = base.get(key)
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            merged[key] = apply_differences(before, value, append, f"{above}{key}.")
        elif f"{above}{key}" in append:
            merged[key] = [*(before or []), *value]
        else:
            merged[key] = value
    return merged


def refuse_no_lists(append: Sequence[str], own: Mapping[str, Any], base: Mapping[str, Any]) -> None:
    """Raise TextInputError if a key of `append` is no list of the file, or not a list of the other one."""
    for key in append:
        for tables, whose in ((own, "this file"), (base, "`like`")):
            value: Any = tables
            for part in split_key(key):
                value = value.get(part) if isinstance(value, Mapping) else None
            if not isinstance(value, list) and not (value is None and tables is base):
                raise TextInputError(
                    f"append names {key!r}, which is no list of {whose}; give the dotted key of a list, "
                    "e.g. 'script.commands'"
                )


def cases_of(vary: Sequence[Mapping[str, Any]], file_name: str) -> dict[str, dict[str, Any]]:
    """The values of each case by dotted keys, by the case's name; empty without axes. Raises TextInputError.

    A case without the key `name` is named by `file_name`, and the first key of each axis with its value.
    """
    axes = [columns_of(axis, f"vary.{number}") for number, axis in enumerate(vary)]
    numbers = [range(len(next(iter(axis.values())))) for axis in axes]
    if (size := math.prod(map(len, numbers))) > LARGEST_GRID:
        raise TextInputError(f"the tables [[vary]] make {size} cases; wanted at most {LARGEST_GRID}")
    if (count := size * sum(map(len, axes))) > MOST_VALUES:
        raise TextInputError(
            f"the tables [[vary]] make {size} cases with {count} values; wanted at most {MOST_VALUES}"
        )
    cases: dict[str, dict[str, Any]] = {}
    for steps in product(*numbers) if axes else ():
        values: dict[str, Any] = {}
        words = [file_name]
        for axis, step in zip(axes, steps, strict=True):
            if twice := values.keys() & axis.keys():
                raise TextInputError(f"two tables [[vary]] give {min(twice)!r}; give it in one of them")
            values |= {key: column[step] for key, column in axis.items()}
            words.append(word_of(axis, step))
        name = values.pop("name", "-".join(words))
        if not isinstance(name, str) or NAME.fullmatch(name) is None:
            raise TextInputError(
                f"vary: a case has the name {name!r}; wanted letters, digits, '-', '_', '+' or '.', "
                "at most 150 of them"
            )
        if name in cases:
            raise TextInputError(f"vary: two cases have the name {name!r}; give each a name of its own")
        cases[name] = values
    return cases


def columns_of(axis: Mapping[str, Any], where: str) -> dict[str, list[Any]]:
    """The values by dotted keys of one table [[vary]]; raises TextInputError."""
    columns: dict[str, list[Any]] = {}
    left = list(axis.items())
    while left:
        key, value = left.pop(0)
        if isinstance(value, Mapping):
            left[:0] = [(f"{key}.{name}", inner) for name, inner in value.items()]
            continue
        if split_key(key)[0] in FileTable.model_fields:
            raise TextInputError(f"{where}.{key}: like, append, vary and search hold for all cases of a file")
        if not isinstance(value, list) or not value:
            raise TextInputError(f"{where}.{key} = {value!r}; give a list with a value for each case")
        if key in columns:
            raise TextInputError(f"{where} gives {key!r} twice; give it once")
        columns[key] = value
    if not columns:
        raise TextInputError(f"{where} is empty; give keys of the scenario, each with a list of values")
    first, *others = columns
    for other in others:
        if len(columns[other]) != len(columns[first]):
            raise TextInputError(
                f"{where}.{other} has {len(columns[other])} values, and {where}.{first} has "
                f"{len(columns[first])}; give both the same number of values, or each a [[vary]] of its own"
            )
    return columns


def word_of(axis: Mapping[str, Sequence[Any]], step: int) -> str:
    """The part of a case's name for one axis: its first key, and the value or else its place from 1."""
    key, column = next(iter(axis.items()))
    value = str(column[step])
    plain = isinstance(column[step], str | int | float) and NAME.fullmatch(f"x{value}")
    return f"{key.rpartition('.')[2]}-{value if plain else step + 1}"


def set_values(document: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scenario's tables with the values of a case; raises TextInputError."""
    changed: dict[str, Any] = deepcopy(dict(document))
    for key, value in values.items():
        try:
            put(changed, split_key(key), value)
        except TextInputError as error:
            raise TextInputError(f"vary: {error}") from error
    return changed


# --- sets of checks -------------------------------------------------------------------------------------


@cache
def check_sets() -> Mapping[str, Mapping[str, Any]]:
    """The named sets of checks: the `title` and the `checks` of each. A set may leave limits open."""
    return read_toml(CHECK_SETS, "sets of checks", "install the package again")


def expand_sets(entries: object, inherited: int = 0) -> Any:
    """The checks of a scenario, with each name of a set replaced by its checks; raises TextInputError.

    A check with the name of an earlier one of a set, or of the first `inherited` entries, changes its keys.
    """
    if not isinstance(entries, list):
        return entries
    checks: list[Any] = []
    places: dict[Any, int] = {}
    for number, entry in enumerate(entries):
        shared = number < inherited or isinstance(entry, str)
        for check in check_set(entry) if isinstance(entry, str) else [entry]:
            name = check.get("name") if isinstance(check, Mapping) else None
            if isinstance(name, str) and name in places:
                checks[places[name]] = change_keys(checks[places[name]], check)
                continue
            if isinstance(name, str) and shared:
                places[name] = len(checks)
            checks.append(check)
    return checks


def check_set(name: str) -> list[dict[str, Any]]:
    """The checks of a set; raises TextInputError."""
    if name not in check_sets():
        listing = "`vibrohil list check-sets` shows all of them"
        raise TextInputError(f"{name!r} is no set of checks; {nearest(name, check_sets(), listing)}")
    return deepcopy(check_sets()[name]["checks"])


def change_keys(check: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A check with other keys; a required value replaces bounds, and bounds a required value."""
    gone: set[str] = set()
    if "equals" in changes:
        gone = {"low", "high"}
    elif changes.keys() & {"low", "high"}:
        gone = {"equals"}
    return {key: value for key, value in check.items() if key not in gone} | dict(changes)
