"""The differences between two suites, as `suite --baseline` and `compare` show them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Column

from tools.output import BadInputError, console, figure, table_of

PREVIOUS = "previous"
MOST_SHOWN = 10
"""Largest number of figures shown, so that they fit one screen; --json and the suite's page have all."""
COLORS = {"better": "green", "worse": "bold red"}


def baseline_result(place: str) -> dict[str, Any]:
    """The result of the suite in a folder; `previous` stands for the newest suite under runs/."""
    from hil.bench.compare_suites import SuiteError, read_suite
    from hil.record.run_folder import RUNS, SUITE_NOTE

    folder = Path(place)
    if place == PREVIOUS:
        results = sorted(RUNS.glob(f"*/{SUITE_NOTE}"), key=lambda path: path.stat().st_mtime)
        if not results:
            raise BadInputError(f"--baseline {PREVIOUS}: there is no suite in {RUNS}/; give a suite's folder")
        folder = results[-1].parent
    try:
        return read_suite(folder)
    except SuiteError as error:
        raise BadInputError(f"--baseline: {error}") from error


def show_changes(changes: Sequence[Mapping[str, Any]]) -> None:
    """Print the largest changes of checked figures, then the number of figures with each verdict."""
    differing = [one for one in changes if not one["equal"]]
    titles = ("scenario", "figure", "before", "after", "margin before", "after", "")
    table = table_of(Column(title, overflow="fold") for title in titles)
    for one in differing[:MOST_SHOWN]:
        values = (
            figure(one[side], one["unit"]) for side in ("before", "after", "margin_before", "margin_after")
        )
        color = COLORS.get(one["verdict"], "dim")
        table.add_row(
            *map(escape, (one["scenario"], one["figure"], *values)), f"[{color}]{one['verdict']}[/]"
        )
    if differing:
        console.print(table)
    counts = {verdict: sum(one["verdict"] == verdict for one in changes) for verdict in ("better", "worse")}
    few = sum(one["verdict"] == "differs" for one in changes)
    console.print(
        f"of {len(changes)} figures {len(changes) - len(differing)} are equal, {counts['better']} better, "
        f"{counts['worse']} worse"
        + (f"; {few} differ, too few seeds to judge them: --seeds 10" if few else "")
    )
