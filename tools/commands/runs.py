"""`vibrohil runs`: the catalogue of runs."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from tools.commands.options import Json
from tools.output import EXIT_NOTHING_RAN, EXIT_PASSED, answer, console, figure, mark_verdict, print_columns

if TYPE_CHECKING:
    from tools.runs.catalogue import ListedRun

COLUMNS = ("regime", "fault", "impact_v_m_s", "estimate.x_rmse_m")
"""Figures that the table shows by default."""
MOST = 40
"""Default for the largest number of runs in the table."""


def runs(
    folder: Annotated[Path, typer.Argument(help="The folder of the runs.")] = Path("runs"),
    where: Annotated[
        list[str] | None,
        typer.Option(
            help="Keep runs with FIGURE<VALUE, e.g. 'impact_v_m_s>0.9' or passed=false; repeatable."
        ),
    ] = None,
    show: Annotated[list[str] | None, typer.Option(help="Name of a figure to show; repeatable.")] = None,
    most: Annotated[
        int | None,
        typer.Option(
            help="The largest number of runs, the newest first; by default 40, with --json all.", min=1
        ),
    ] = None,
    older: Annotated[
        str | None, typer.Option("--prune", help="Remove the listed runs that are older than this, e.g. 30d.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the runs with their verdicts and key figures."""
    from tools.runs.catalogue import age_s, choose, list_runs, prune, refuse_other_figures

    for name in show or []:
        refuse_other_figures("--show", name, name)
    known = list_runs(folder)
    found = choose(known, where or [])
    if older is not None:
        found = found[:most]
        pruned = prune(found, age_s(older), folder)
        summary = f"removed {len(pruned.removed)} of {len(found)} runs"
        summary += f"; {len(pruned.in_use)} are in progress and stay" if pruned.in_use else ""
        answer(pruned._asdict(), as_json, lambda: console.print(summary))
        return
    columns = show or list(COLUMNS)
    shown = found[: (None if as_json else MOST) if most is None else most]
    payload = {"runs": [row_of(run, columns) for run in shown]}
    status = EXIT_PASSED if found else EXIT_NOTHING_RAN
    which = f"matching runs of {len(known)}" if where else "runs"
    counts = f"{len(shown)} of {len(found)} {which} in {folder}"
    answer(payload, as_json, lambda: print_table(shown, columns, counts), status)


def row_of(run: "ListedRun", columns: list[str]) -> dict[str, Any]:
    """One run as a JSON object."""
    return {
        "folder": str(run.folder),
        "scenario": run.figure("scenario"),
        "clock": run.figure("clock"),
        "passed": run.passed,
        "verdict": run.word,
        "begun_s": run.begun_s,
        "provenance": (run.verdict or {}).get("provenance"),
        "figures": {name: run.figure(name) for name in columns},
    }


def print_table(shown: "list[ListedRun]", columns: list[str], counts: str) -> None:
    """Print a line for each run, then their number."""
    words = ["[dim]no verdict[/]" if run.word is None else mark_verdict(run.word) for run in shown]
    begun = [time.strftime("%Y-%m-%d %H:%M", time.localtime(run.begun_s)) for run in shown]
    texts = {
        "scenario": [figure(run.figure("scenario")) for run in shown],
        "commit": [run.commit for run in shown],
        **{name: [figure(run.figure(name)) for run in shown] for name in columns},
        "folder": [str(run.folder) for run in shown],
    }
    cells = {title: list(map(escape, column)) for title, column in texts.items()}
    print_columns({"begun": begun, "verdict": words, **cells}, ())
    console.print(counts, markup=False)
