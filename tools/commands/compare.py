"""`vibrohil compare A B`: two runs side by side."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import Json
from tools.commands.places import RECORDINGS, new_option
from tools.output import (
    EXIT_CHECK_FAILED,
    EXIT_NOTHING_RAN,
    EXIT_PASSED,
    answer,
    console,
    figure,
    mark_verdict,
    table_of,
)
from tools.runs.changes import Tolerances, flip, show_changes, tolerances_of

MOST_CHANGES = 10
"""Largest number of figures shown, so that they fit one screen; --json has all."""


def compare(
    a: Annotated[Path, typer.Argument(help="A run folder, an .rrd file, or a suite's folder.")],
    b: Annotated[Path, typer.Argument(help="The other one.")],
    out: Annotated[
        Path | None, new_option("Write both runs to one new .rrd file; open it with view.", RECORDINGS)
    ] = None,
    must_be_equal: Annotated[
        bool,
        typer.Option(
            "--must-be-equal",
            help="Check that the runs are equal bit by bit, or within --tolerance: exit status 1 if not.",
        ),
    ] = False,
    tolerance: Tolerances = None,
    as_json: Json = False,
) -> None:
    """Show changed verdicts, figures beyond their tolerance, and the first moment at which two runs differ.

    For two suites: show which checked figures are better or worse, and which verdicts differ; they are equal
    if they have the same scenarios, seeds and verdicts, and all figures are within their tolerance. The exit
    status is 0 even if the runs differ, unless --must-be-equal is given.
    """
    from hil.suite.compare_suites import is_suite

    if is_suite(a) or is_suite(b):
        compare_suites(a, b, must_be_equal, tolerance, as_json)
        return
    from hil.runs.recorded_run import open_run
    from tools.runs import comparison

    runs = open_run(a), open_run(b)
    result = comparison.compare(*runs, tolerances_of(tolerance))
    if out is not None:
        found = result["first_difference"]
        comparison.write_overlay(*runs, None if found is None else comparison.Difference(**found), out)
        result["out"] = str(out)
    equal = result["equal"] if tolerance is None else result["within_tolerance"]
    status = EXIT_CHECK_FAILED if must_be_equal and not equal else EXIT_PASSED

    def show_both() -> None:
        console.print(f"a: {a}\nb: {b}\n", soft_wrap=True, markup=False)
        show(result)

    answer(result, as_json, show_both, status)


def compare_suites(a: Path, b: Path, must_be_equal: bool, tolerance: list[str] | None, as_json: bool) -> None:
    """Show the verdicts that differ; exit with status 5 if the suites have no scenario in common."""
    from hil.suite.compare_suites import compare, read_suite

    result = compare(read_suite(a), read_suite(b), tolerances_of(tolerance))
    status = EXIT_CHECK_FAILED if must_be_equal and not result["equal"] else EXIT_PASSED
    answer(result, as_json, lambda: show_suites(result), status if result["compared"] else EXIT_NOTHING_RAN)


def show_suites(result: dict[str, Any]) -> None:
    """Print the changed checks, the scenarios whose verdict differs, and what only one suite has."""
    show_changes(result["changes"])
    for one in result["verdicts"]:
        console.print(f"{escape(one['scenario'])}: {flip(one['a'], one['b'])}", soft_wrap=True)
    for side in ("a", "b"):
        if result[f"only_in_{side}"]:
            console.print(f"only in {side}: {', '.join(result[f'only_in_{side}'])}", markup=False)
        if result[f"seeds_only_in_{side}"]:
            seeds = ", ".join(map(str, result[f"seeds_only_in_{side}"]))
            console.print(f"seeds only in {side}, not compared: {seeds}", markup=False, soft_wrap=True)
    number = len(result["compared"])
    same = f"{number - len(result['verdicts'])} of {number} scenarios have the same verdict"
    console.print(f"{same} ({' and '.join(result['clocks'])})")


def show(result: dict[str, Any]) -> None:
    """Print both verdicts, the largest changes, the machine's timing and the signals' first difference."""
    from tools.runs import comparison

    figures, changes = result["figures"], result["largest_changes"]
    table = table_of(Column(title, no_wrap=True) for title in ("figure", "a", "b", "b − a"))
    table.add_row("verdict", *map(mark_verdict, (result["verdict"][side] for side in ("a", "b"))), "")
    table.add_row("latched fault", figures["fault"]["a"], figures["fault"]["b"], "")
    for one in result["flips"]:
        both = (figure(one[f"value_{side}"], one["unit"]) for side in ("a", "b"))
        table.add_row(escape(f"{one['name']} {one['limit']}"), *map(escape, both), flip(one["a"], one["b"]))
    physical = [name for name in changes if not comparison.is_timing(name) and name != "fault"]
    for name in physical[:MOST_CHANGES]:
        row = figures[name]
        table.add_row(name, *(escape(figure(row[side], row["unit"])) for side in ("a", "b", "change")))
    console.print(table)
    more = f"; the {MOST_CHANGES} largest changes are shown" if len(physical) > MOST_CHANGES else ""
    equal = len(figures) - len(changes)
    console.print(f"{equal} of {len(figures)} figures are equal within their tolerance{more}")
    work = figures["tick_us.p99"]
    if None not in (work["a"], work["b"]):  # lockstep does not measure it
        console.print(
            f"the machine: firmware work p99 {figure(work['a'])} and {figure(work['b'])} µs, "
            f"overruns {figure(figures['overruns']['a'])} and {figure(figures['overruns']['b'])}",
            style="dim",
        )
    first = result["first_difference"]
    if first is None:
        console.print("[bold green]equal[/]: every logged signal, bit by bit, on simulated time")
    elif first["signal"] in comparison.ENDS:
        console.print(
            f"[bold]first difference[/]: a ends at {first['a']:.6f} s and b at {first['b']:.6f} s; "
            "every logged signal is equal until the earlier end",
            soft_wrap=True,
        )
    else:
        values = f"{figure(first['a'])} in a, {figure(first['b'])} in b"
        console.print(
            f"[bold]first difference[/] at {first['t_s']:.6f} s in {first['signal']}: {escape(values)}",
            soft_wrap=True,
        )
    if "out" in result:
        console.print(f"overlaid in {result['out']}", soft_wrap=True, markup=False)
