"""`vibrohil suite [NAME…]`: many scenarios, one page and one JUnit file."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import (
    MOST_TRIALS,
    Change,
    Controller,
    Json,
    ParameterFiles,
    RealTime,
    note_unused_bus,
)
from tools.commands.places import folder_option
from tools.output import BadInputError, answer, console, exit_of, figure, mark_verdict, table_of
from tools.progress import shown_progress
from tools.runs.changes import Tolerances, baseline_result, show_changes, tolerances_of

MOST_LACKING = 5
"""Most names of scenarios and checks that are printed of those that only the baseline has."""


def suite(
    names: Annotated[
        list[str] | None, typer.Argument(help="Scenarios by name or file; by default all.")
    ] = None,
    clock: Annotated[
        Literal["real", "lockstep"],
        typer.Option(help="real: one run at a time; lockstep: several at a time."),
    ] = "lockstep",
    time: RealTime = "held",
    bus: Annotated[str, typer.Option(help="The bus of real-time runs, as for run.")] = "auto",
    firmware: Controller = "compiled",
    out: Annotated[
        Path | None, folder_option("The folder for all runs; by default a new one under runs/.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 1,
    seeds: Annotated[
        int,
        typer.Option(
            help="Run each scenario with this number of seeds, from --seed on; all must pass.",
            min=1,
            max=MOST_TRIALS,
        ),
    ] = 1,
    change: Change = None,
    parameters: ParameterFiles = None,
    baseline: Annotated[
        str | None, typer.Option(help="Compare with this suite: its folder, or previous for the newest one.")
    ] = None,
    tolerance: Tolerances = None,
    jobs: Annotated[int, typer.Option(help="Lockstep runs at the same time.", min=1)] = 2,
    as_json: Json = False,
) -> None:
    """Run many scenarios and judge each.

    The exit status is 1 if a check failed, else 5 if nothing ran or a run was not judged.
    """
    from hil.runs.job import RunOptions
    from hil.suite.changes import Baseline
    from hil.suite.suite import Chosen, run_suite

    note_unused_bus(bus, clock)
    before = None if baseline is None else baseline_result(baseline)
    tolerances = tolerances_of(tolerance)
    if tolerances and before is None:
        raise BadInputError("--tolerance: a suite uses this with --baseline only; leave it out")
    with shown_progress() as progress:
        every_seed = range(seed, seed + seeds)
        result = run_suite(
            Chosen(names or [], change or [], parameters or []),
            RunOptions(clock=clock, time=time, bus=bus, firmware=firmware),
            out,
            every_seed,
            progress,
            jobs,
            None if before is None else Baseline(before, tolerances),
        )
    answer(result, as_json, lambda: show(result), exit_of(result))


def show(result: dict[str, Any]) -> None:
    """Print each scenario's verdict and failures, the suite's verdict, and the changes to a baseline."""
    many = len(result["seeds"]) > 1
    table = table_of((Column(overflow="fold") for _ in range(2)), show_header=False)
    for one in result["scenarios"]:
        seeds = f"[bold]{one['passed_seeds']} of {one['seeds']}[/]  " if many else ""
        table.add_row(mark_verdict(one["verdict"]), seeds + escape(one["name"]))
        for reason in one["reasons"]:
            table.add_row("", f"  [red]{escape(reason)}[/]")
        for reason in one["not_judged"]:
            table.add_row("", f"  [yellow]not judged: {escape(reason)}[/]")
        for check in one["checks"] if many else (check for check in one["checks"] if not check["passed"]):
            table.add_row("", f"  {line_of(check, many)}")
    console.print(table)
    if result["left_out"]:
        console.print(f"left out, for lockstep alone: {', '.join(result['left_out'])}", markup=False)
    passed = sum(one["verdict"] == "passed" for one in result["scenarios"])
    not_judged = sum(one["verdict"] == "not-judged" for one in result["scenarios"])
    in_seeds = f" in each of {len(result['seeds'])} seeds" if many else ""
    console.print(
        f"{passed} of {len(result['scenarios'])} passed{in_seeds}"
        f"{f', {not_judged} not judged' if not_judged else ''} in {result['wall_s']:.0f} s "
        f"{result['report'] or ''}",
        soft_wrap=True,
        markup=False,
    )
    if failures := result["failures"]["sentence"]:
        console.print(failures, soft_wrap=True, markup=False)
    if result["changed"]:
        console.print(f"each scenario with {', '.join(result['changed'])}", soft_wrap=True, markup=False)
    if result["changes"] is not None:
        show_changes(result["changes"])
    if lacking := result["only_in_baseline"]:
        more = f" … and {len(lacking) - MOST_LACKING} more" if len(lacking) > MOST_LACKING else ""
        console.print(f"only in the baseline: {', '.join(lacking[:MOST_LACKING])}{more}", markup=False)


def line_of(check: dict[str, Any], many: bool) -> str:
    """A check's figure beside its limit; for many seeds the range, and the seed nearest to the limit."""
    value = figure(check["value"], check["unit"])
    if many and check["lowest"] is not None and check["lowest"] < check["highest"]:
        value = f"{figure(check['lowest'], '')} … {figure(check['highest'], check['unit'])}"
    reason = f": {check['reason']}" if check["reason"] else ""
    proves = f" ({check['requirement']})" if check["requirement"] else ""
    if check["required"]:
        proves = f" (own limit; {check['requirement']} requires {check['required']})"
    text = escape(f"{check['name']} = {value}, wanted {check['limit']}{proves}{reason}")
    if check["verdict"] == "not-judged":
        return f"[yellow]{text} (not judged)[/]"
    if not many:
        return f"[red]{text}[/]"
    if check["passed"]:
        return f"[dim]{text}[/]"
    return f"[red]{text}, not met in seed {check['seed']}; met in {check['passed_seeds']} seeds[/]"
