"""Reads scenarios: those that come with the package, in hil/scenarios, and a user's own files.

A file holds one scenario, or several cases of one. `read_scenario` returns complete tables: what the file
refers to is written out, in this order: a scene and tuned parameters, another scenario (`like`), the values
of the case (`vary`), the sets of checks.
"""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from hil.record.formats import SCENARIO, FormatError, refuse_other_format
from hil.scenario.parameter_file import read_parameters
from hil.scenario.search import MOST_KEYS, SearchTable
from hil.scenario.settings import put, split_key
from plant_sim.scene import read_scene
from plant_sim.tables.table import Table
from plant_sim.validation_messages import messages_of, nearest
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


SCENARIOS = Path(__file__).parents[1] / "scenarios"


class ScenarioError(TextInputError):
    """A scenario cannot be run; the message has one sentence per error."""


@cache
def shipped_scenarios() -> Mapping[str, tuple[Path, str | None]]:
    """File and case, as `locate` returns them, of each scenario that comes with the package, by name."""
    found: dict[str, tuple[Path, str | None]] = {}
    for path in sorted(SCENARIOS.rglob("*.toml")):
        cases: list[str | None] = [*case_names(path)] or [None]
        found |= {case or path.stem: (path, case) for case in cases}
    return found


def scenario_names() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(shipped_scenarios())


def locate(source: str | Path) -> tuple[Path, str | None]:
    """The file of a scenario, and its case if the file has several: of a name, FILE.toml or FILE.toml::CASE.

    A text without a slash that does not end in .toml is a name. Raises `ScenarioError`.
    """
    file, separator, case = str(source).partition("::")
    if separator and file.endswith(".toml"):
        return Path(file), case
    if isinstance(source, Path) or source.endswith(".toml") or "/" in source:
        return Path(source), None
    if source not in shipped_scenarios():
        raise ScenarioError(
            f"{source!r} is no named scenario; "
            f"{nearest(source, shipped_scenarios(), '`vibrohil list` shows all of them')} "
            "(a file's path ends in .toml)"
        )
    return shipped_scenarios()[source]


def scenario_name(source: str | Path) -> str:
    """The name of a scenario: that of its case, or else of its file; it also names the run's folder."""
    path, case = locate(source)
    name = case or path.stem
    if not name.strip("."):  # folders of these names are the suite's own folder, or above it
        raise ScenarioError(f"scenario file {str(path)!r} has no name but dots; rename it")
    return name


def sources_in(source: str) -> list[str]:
    """The scenarios that a name or a file stands for: all cases of a file, each as FILE.toml::CASE."""
    path, case = locate(source)
    names = case_names(path) if case is None else []
    return [f"{path}::{name}" for name in names] or [source]


def case_names(path: Path) -> list[str]:
    """The names of the cases in a scenario's file; none if it has no table [[vary]]."""
    document = read_file(path)
    with name_file_in_errors(path):
        return list(cases_of(references_of(document).vary, path.stem))


def read_file(path: Path) -> dict[str, Any]:
    """The tables of a scenario's file as written."""
    document = read_toml(path, "scenario file", "give a scenario's file, or the name of a scenario")
    try:
        refuse_other_format(f"scenario file {str(path)!r}", document, SCENARIO, "see docs/formats.md")
    except FormatError as error:
        raise ScenarioError(str(error)) from error
    if "striker" in document and "script" not in document:
        raise ScenarioError(
            f"{str(path)!r} is a scene; use `vibrohil simulate`, or name it in a scenario, "
            f"scene = {path.name!r}"
        )
    return document


def read_scenario(source: str | Path) -> dict[str, Any]:
    """The complete tables of a named scenario, of a TOML file, or of a case of one.

    Raises `ScenarioError`, the scene's `SceneError`, a file's `TextInputError` or the firmware's
    `ParameterError`.
    """
    tables, inherited = read_tables(source)
    if "checks" in tables:
        with name_file_in_errors(locate(source)[0]):
            tables["checks"] = expand_sets(tables["checks"], inherited)
    return {"firmware": {}, **tables}


def read_tables(source: str | Path, *, is_base: bool = False) -> tuple[dict[str, Any], int]:
    """A scenario's tables with the names of sets of checks, and the number of checks from `like`.

    `is_base`: of a scenario that another one is like.
    """
    path, case = locate(source)
    document = read_file(path)
    own = resolve_names({key: document[key] for key in document if key not in FileTable.model_fields}, path)
    with name_file_in_errors(path):
        references = references_of(document)
        tables, inherited = own, 0
        if references.like is not None:
            if is_base:
                raise TextInputError(
                    f"like = {references.like!r}: a scenario that another file is like cannot have `like` "
                    f"itself; be like {references.like!r} there, or write this scenario out"
                )
            base, _ = read_tables(beside(path, references.like), is_base=True)
            base.pop("title", None)
            refuse_no_lists(references.append, own, base)
            tables = apply_differences(base, own, references.append)
            inherited = len(base.get("checks", ())) if "checks" in references.append else 0
        elif references.append:
            raise TextInputError("append continues the lists of `like`, which is missing; add it")
        values = values_of_case(cases_of(references.vary, path.stem), case, path)
        return resolve_names(set_values(tables, values), path), inherited


def search_tables(source: str | Path) -> list[SearchTable]:
    """The tables [[search]] of a scenario's own file."""
    path, _ = locate(source)
    document = read_file(path)
    with name_file_in_errors(path):
        return references_of(document).search


def values_of_case(cases: Mapping[str, Mapping[str, Any]], case: str | None, path: Path) -> Mapping[str, Any]:
    """The values of one of a file's cases by dotted keys; none for a file without cases."""
    if case is None and not cases:
        return {}
    if case is None:
        first = ", ".join(f"{path}::{name}" for name in list(cases)[:3])
        raise TextInputError(f"it has {len(cases)} cases; name one of them, such as {first}")
    if case not in cases:
        known = nearest(case, cases) if cases else "it has no [[vary]]; name the file alone"
        raise TextInputError(f"it has no case {case!r}; {known}")
    return cases[case]


def references_of(document: Mapping[str, Any]) -> FileTable:
    """The keys of a scenario's file that refer to other tables; raises TextInputError."""
    try:
        return FileTable.model_validate(
            {key: document[key] for key in FileTable.model_fields if key in document}
        )
    except ValidationError as error:
        raise TextInputError("\n".join(messages_of(error, FileTable))) from error


def beside(path: Path, name: str) -> str | Path:
    """A name, or the path of a file relative to the folder of the scenario's file at `path`."""
    return path.parent / name if ".toml" in name or "/" in name else name


def resolve_names(tables: dict[str, Any], path: Path) -> dict[str, Any]:
    """The tables with those of a named scene and of a file of parameters in the place of the names."""
    if isinstance(scene := tables.get("scene"), str):
        tables["scene"] = read_scene(beside(path, scene))
    if isinstance(firmware := tables.get("firmware"), str):
        tables["firmware"] = read_parameters(path.parent / firmware)
    return tables


@contextmanager
def name_file_in_errors(path: Path) -> Iterator[None]:
    """Raise errors about a scenario's tables as `ScenarioError`s that name its file."""
    try:
        yield
    except TextInputError as error:
        raise ScenarioError(f"scenario file {str(path)!r}: {error}") from error
