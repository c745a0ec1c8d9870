"""`vibrohil runs`: the catalogue of runs."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import Json
from tools.output import EXIT_NOTHING_RAN, BadInputError, answer, console, figure, print_json, table_of

if TYPE_CHECKING:
    from tools.logs.catalogue import ListedRun

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
    view: Annotated[
        bool, typer.Option(help="Open the listed runs side by side in the Rerun viewer.")
    ] = False,
    older: Annotated[
        str | None, typer.Option("--prune", help="Remove the listed runs that are older than this, e.g. 30d.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the runs with their verdicts and key figures."""
    from tools.logs.catalogue import age_s, chosen, listed, prune, refuse_other_figures

    for name in show or []:
        refuse_other_figures("--show", name, name)
    found = chosen(listed(folder), where or [])
    if older is not None:
        removed = prune(found, age_s(older))
        summary = f"removed {len(removed)} of {len(found)} runs"
        answer({"removed": [str(path) for path in removed]}, as_json, lambda: console.print(summary))
        return
    columns = show or list(COLUMNS)
    shown = found[: (None if as_json else MOST) if most is None else most]
    if as_json:
        print_json({"runs": [row_of(run, columns) for run in shown]})
    else:
        print_table(shown, columns)
        console.print(f"{len(shown)} of {len(found)} runs in {escape(str(folder))}")
    if not found:
        raise typer.Exit(EXIT_NOTHING_RAN)
    if view:
        open_side_by_side(found[: most or MOST])


def row_of(run: "ListedRun", columns: list[str]) -> dict[str, Any]:
    """One run as a JSON object."""
    return {
        "folder": str(run.folder),
        "scenario": run.figure("scenario"),
        "clock": run.figure("clock"),
        "passed": run.passed,
        "begun_s": run.begun_s,
        "provenance": (run.verdict or {}).get("provenance"),
        "figures": {name: run.figure(name) for name in columns},
    }


def print_table(shown: "list[ListedRun]", columns: list[str]) -> None:
    """Print a line for each run."""
    words = {True: "[green]passed[/]", False: "[bold red]failed[/]", None: "[dim]no verdict[/]"}
    titles = ("begun", "", "scenario", "commit", *columns, "folder")
    table = table_of(Column(title, overflow="fold") for title in titles)
    for run in shown:
        begun = time.strftime("%Y-%m-%d %H:%M", time.localtime(run.begun_s))
        name, figures = figure(run.figure("scenario")), [figure(run.figure(name)) for name in columns]
        table.add_row(begun, words[run.passed], *map(escape, (name, run.commit, *figures, str(run.folder))))
    console.print(table)


def open_side_by_side(shown: "list[ListedRun]") -> None:
    """Open the logs of the runs in one viewer."""
    from tools.logs.view import view_together

    folders = [run.folder for run in shown if (run.folder / "run.rrd").exists()]
    if not folders:
        raise BadInputError(
            "--view: none of these runs has a log; run one again without a suite of many seeds"
        )
    view_together(folders)
