"""Reads scenarios: those that come with the package, in hil/scenarios, and a user's own files.

A file holds one scenario, or several cases of one. `read_scenario` returns complete tables: what the file
refers to (a scene, tuned parameters, another scenario, sets of checks) is written out.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hil.record.formats import SCENARIO, FormatError, refuse_other_format
from hil.scenario.differences import (
    FileTable,
    apply_differences,
    cases_of,
    expand_sets,
    refuse_no_lists,
    set_values,
)
from hil.scenario.parameter_file import read_parameters
from hil.scenario.search import SearchTable
from plant_sim.scene import read_scene
from plant_sim.validation_messages import messages_of, nearest
from text_input import TextInputError, read_toml

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
