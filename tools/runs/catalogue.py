"""The catalogue of runs: every folder that a run made, with its verdict, and conditions on them."""

import json
import operator
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hil.figures.records import CATALOGUE
from hil.judge.verdict import Verdict
from hil.record import formats
from hil.record.formats import plain
from hil.record.run_folder import RUNS, begun_s, discard_unused, is_own, read_note
from hil.run_files import RunFile
from tools.output import BadInputError

COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "!=": operator.ne,
    "=": operator.eq,
    "<": operator.lt,
    ">": operator.gt,
}
CONDITION = re.compile(r"\s*([a-z_][a-z0-9_.]*)\s*(<=|>=|!=|=|<|>)\s*(.+?)\s*")
UNITS_S = {"h": 3600.0, "d": 86_400.0, "w": 604_800.0}
VERDICT_NAMES = ("passed", "verdict")
"""What conditions and tables may name beside the figures."""
AGE = re.compile(r"(\d+(?:\.\d+)?)([hdw])")


@dataclass(frozen=True)
class ListedRun:
    """One run folder; `verdict` is None for a run that is not finished or left no verdict."""

    folder: Path
    begun_s: float
    """Time at which the run began, in s since 1970."""
    verdict: dict[str, Any] | None
    """What `known_of` keeps of the verdict."""

    @property
    def passed(self) -> bool | None:
        """Whether the run has passed; None without a verdict or if it is not judged."""
        return None if self.verdict is None else self.verdict["passed"]

    @property
    def word(self) -> Verdict | None:
        """The verdict; None for a run that left none."""
        if self.verdict is None:
            return None
        return {True: Verdict.PASSED, False: Verdict.FAILED}.get(self.verdict["passed"], Verdict.NOT_JUDGED)

    @property
    def commit(self) -> str:
        """The first digits of the commit, with + where files had been edited since."""
        origin = (self.verdict or {}).get("provenance", {})
        return f"{str(origin.get('commit') or '')[:8]}{'+' if origin.get('edited') else ''}"

    def figure(self, name: str) -> Any:
        """A figure by its dotted name, `passed` or `verdict`; None if the run lacks it."""
        if name in VERDICT_NAMES:
            return self.passed if name == "passed" else self.word
        return None if self.verdict is None else self.verdict["figures"].get(name)


def known_of(verdict: Mapping[str, Any]) -> dict[str, Any] | None:
    """The verdict, origin and figures in a verdict.json, which may be of another version or made up.

    None if it holds no verdict. Only texts, numbers and null are kept, so that many runs take little memory.
    """
    if "passed" not in verdict or not isinstance(verdict["passed"], bool | None):
        return None
    origin = verdict.get("provenance")
    figures = {name: figure_in(verdict, name) for name in CATALOGUE}
    return {
        "passed": verdict["passed"],
        "provenance": {key: scalar(value) for key, value in origin.items()}
        if isinstance(origin, dict)
        else {},
        "figures": figures,
    }


def figure_in(verdict: Mapping[str, Any], name: str) -> Any:
    """A figure by its dotted name; None if a verdict.json lacks it."""
    value: Any = verdict
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return scalar(value)


def scalar(value: Any) -> Any:
    """A text or number as it is; None for anything else, and for a number that is not finite."""
    return plain(value) if isinstance(value, str | int | float) else None


def list_runs(runs: Path) -> list[ListedRun]:
    """Every run in the folder `runs` and its subfolders, including suites, the newest first.

    Raises BadInputError for a place that is no folder; only the default one may be missing, before any run.
    """
    if not runs.is_dir() and runs != RUNS:
        raise BadInputError(f"{runs} is no folder; name one that holds runs")
    found = []
    for document in runs.glob(f"**/{RunFile.NOTE}"):
        folder = document.parent
        verdict = read_note(folder / RunFile.VERDICT)
        is_known = verdict.get(formats.KEY, formats.VERDICT) == formats.VERDICT
        found.append(ListedRun(folder, begun_s(folder), known_of(verdict if is_known else {})))
    return sorted(found, key=lambda run: run.begun_s, reverse=True)


def refuse_other_figures(option: str, text: str, name: str) -> None:
    """Raise BadInputError unless `name` is `passed`, `verdict` or the name of a figure."""
    if name not in CATALOGUE and name not in VERDICT_NAMES:
        raise BadInputError(
            f"{option} {text!r}: no figure {name!r}; docs/reference/figures.md lists them, beside `passed` "
            "and `verdict`"
        )


def condition(text: str) -> Callable[[ListedRun], bool]:
    """A test on runs from a text such as `impact_v_m_s > 0.9` or `fault != none`.

    The left side is a figure's name or `passed`. A run without the figure does not meet the condition.
    """
    match = CONDITION.fullmatch(text)
    if match is None:
        raise BadInputError(
            f"--where {text!r} is no condition; write FIGURE<VALUE, with one of < <= > >= = !="
        )
    name, sign, wanted_text = match.groups()
    refuse_other_figures("--where", text, name)
    try:
        wanted: Any = json.loads(wanted_text)
    except ValueError:
        wanted = wanted_text
    if wanted is None or isinstance(wanted, list | dict):
        raise BadInputError(f"--where {text!r}: wanted a number, true, false or a word after {sign}")
    is_text = name == "verdict" or (name in CATALOGUE and CATALOGUE[name].is_text)
    if is_text and not isinstance(wanted, str):
        wanted = wanted_text
    elif isinstance(wanted, str) and not is_text:
        raise BadInputError(
            f"--where {text!r}: {name} is no text; write a number, true or false after {sign}"
        )
    compare = COMPARISONS[sign]

    def meets(run: ListedRun) -> bool:
        value = run.figure(name)
        if value is None:
            return False
        if isinstance(value, str) != isinstance(wanted, str):
            return sign == "!="
        return compare(value, wanted)

    return meets


def choose(runs: Iterable[ListedRun], conditions: Sequence[str]) -> list[ListedRun]:
    """The runs that meet every condition."""
    tests = [condition(text) for text in conditions]
    return [run for run in runs if all(meets(run) for meets in tests)]


def age_s(text: str) -> float:
    """An age such as 12h, 30d or 2w, in seconds."""
    match = AGE.fullmatch(text)
    if match is None:
        raise BadInputError(f"--prune {text!r} is no age; write a number with h, d or w, such as 30d")
    return float(match[1]) * UNITS_S[match[2]]


class Pruned(NamedTuple):
    """The folders of the runs that were removed, and of those that are in progress and stay."""

    removed: list[Path]
    in_use: list[Path]


def prune(runs: Iterable[ListedRun], older_than_s: float, below: Path) -> Pruned:
    """Remove the files of runs in the folder `below` that began more than `older_than_s` ago.

    A folder that holds other files too stays with these files. A folder that no run has made is not touched,
    nor is a run in progress or any run of a suite in progress.
    """
    latest_s = time.time() - older_than_s
    old = [run.folder for run in runs if run.begun_s < latest_s and is_own(run.folder)]
    is_removed = {folder: discard_unused(folder, below) for folder in old}
    return Pruned(*([folder for folder in old if is_removed[folder] is kind] for kind in (True, False)))
