"""The differences between two suites, as `suite --baseline` and `compare` show them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column

from tools.output import BadInputError, console, figure, table_of

if TYPE_CHECKING:
    from hil.judge.tolerance import Tolerance

PREVIOUS = "previous"
MOST_SHOWN = 10
"""Largest number of figures shown, so that they fit one screen; --json and the suite's page have all."""
Tolerances = Annotated[
    list[str] | None,
    typer.Option(
        "--tolerance",
        help="Change that counts as none: FIGURE=ABSOLUTE[,RELATIVE], or *=… for all; default 1e-12,1e-9, "
        "or a thousandth of a requirement's limit.",
    ),
]
COLORS = {"better": "green", "worse": "bold red"}


def tolerances_of(settings: Sequence[str] | None) -> "dict[str, Tolerance]":
    """The tolerances of `--tolerance`; raises BadInputError."""
    from hil.figures.records import CATALOGUE
    from hil.judge.tolerance import tolerances_from

    try:
        return tolerances_from(settings or [], CATALOGUE)
    except ValueError as error:
        raise BadInputError(f"--tolerance {error}") from error


def baseline_result(place: str) -> dict[str, Any]:
    """The result of the suite in a folder; `previous` stands for the newest suite under runs/."""
    from hil.record.run_folder import RUNS, SUITE_NOTE
    from hil.suite.compare_suites import read_suite

    folder = Path(place)
    if place == PREVIOUS:
        results = sorted(RUNS.glob(f"*/{SUITE_NOTE}"), key=lambda path: path.stat().st_mtime)
        if not results:
            raise BadInputError(f"--baseline {PREVIOUS}: there is no suite in {RUNS}/; give a suite's folder")
        folder = results[-1].parent
    return read_suite(folder)


def flip(before: bool | None, after: bool | None) -> str:
    """A changed verdict for people: in red unless the check is passed now."""
    words = {True: "passed", False: "failed", None: "not judged"}
    return f"[{'green' if after else 'bold red'}]{words[before]} → {words[after]}[/]"


def show_changes(changes: Sequence[Mapping[str, Any]]) -> None:
    """Print changed verdicts, then figures beyond their tolerance, then the number of each kind.

    All changed verdicts are printed, of the other figures the first MOST_SHOWN.
    """
    from hil.suite.changes import FEWEST_PAIRS

    differing = [one for one in changes if not one["equal"]]
    flips = sum(one["flipped"] for one in differing)
    titles = ("scenario", "figure", "before", "after", "margin before", "after", "")
    table = table_of(Column(title, overflow="fold") for title in titles)
    for one in differing[: flips + MOST_SHOWN]:
        values = (
            figure(one[side], one["unit"]) for side in ("before", "after", "margin_before", "margin_after")
        )
        color = COLORS.get(one["verdict"], "dim")
        text = f"[{color}]{one['verdict']}[/]"
        if one["flipped"]:
            text = flip(one["passed_before"], one["passed_after"])
        table.add_row(*map(escape, (one["scenario"], one["figure"], *values)), text)
    if differing:
        console.print(table)
    counts = {verdict: sum(one["verdict"] == verdict for one in changes) for verdict in ("better", "worse")}
    few = sum(one["verdict"] == "differs" for one in changes)
    if flips:
        console.print(f"[bold red]{flips} checks have another verdict[/]")
    console.print(
        f"of {len(changes)} figures {len(changes) - len(differing)} are equal within their tolerance, "
        f"{counts['better']} better, {counts['worse']} worse"
        + (f"; {few} differ, to judge them takes {FEWEST_PAIRS} seeds: --seeds {FEWEST_PAIRS}" if few else "")
    )
