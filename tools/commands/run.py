"""`vibrohil run SCENARIO`: one run of firmware and plant on a bus, with a verdict."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.markup import escape
from rich.table import Column

from hil.run_files import RunFile
from tools.commands.options import Change, Controller, Json, ParameterFiles, RealTime, note_unused_bus
from tools.commands.places import folder_option
from tools.output import (
    BadInputError,
    answer,
    console,
    exit_of,
    figure,
    figure_table,
    mark_verdict,
    table_of,
)
from tools.progress import shown_progress

if TYPE_CHECKING:
    from hil.figures.records import Figures
    from hil.judge.verdict import RunVerdict


def run(
    scenario: Annotated[str, typer.Argument(help="A scenario's name or its TOML file.")],
    clock: Annotated[
        Literal["real", "lockstep"],
        typer.Option(help="real: two processes in real time; lockstep: one process, as fast as possible."),
    ] = "real",
    time: RealTime = "held",
    bus: Annotated[
        str, typer.Option(help="auto, vcan, local, socketcan:can0 or any python-can interface:channel.")
    ] = "auto",
    firmware: Controller = "compiled",
    out: Annotated[Path | None, folder_option("The run folder; by default a new one under runs/.")] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of all random numbers; by default the scenario's, or 1.", min=0)
    ] = None,
    change: Change = None,
    parameters: ParameterFiles = None,
    keep_traces: Annotated[
        bool, typer.Option("--keep-traces", help="Keep the traces of a passed run too.")
    ] = False,
    live: Annotated[
        bool, typer.Option(help="In real time: show the run meanwhile, in a waiting viewer or a new window.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run one scenario, record every signal, and judge it."""
    from hil.runs.bench import run_scenario
    from hil.runs.job import RunOptions
    from hil.scenario.scenario import load_scenario

    loaded = load_scenario(scenario, change or [], parameters or [])
    note_unused_bus(bus, clock)
    viewer = None
    if live:
        from tools.runs.view import live_viewer

        if clock == "lockstep":
            raise BadInputError("--live shows a run in real time; after one in lockstep: `vibrohil view`")
        viewer = live_viewer(may_open=True)
    options = RunOptions(
        clock=clock, time=time, bus=bus, firmware=firmware, viewer=viewer, keep_traces=keep_traces
    )
    with shown_progress() as progress:
        verdict = run_scenario(loaded, options, out, loaded.seed if seed is None else seed, progress)
    payload = verdict.as_json()
    answer(
        payload,
        as_json,
        lambda: show(verdict, title_of(loaded.document["title"], loaded.changes)),
        exit_of(payload),
    )


def title_of(title: str, changes: Sequence[str]) -> str:
    """A scenario's title with what was changed in it.

    >>> title_of("The impacts are held at r = 1.3", ["script.commands.1.target_ratio=1.25"])
    'The impacts are held at r = 1.3, with script.commands.1.target_ratio=1.25'
    """
    return f"{title}, with {', '.join(changes)}" if changes else title


def show(verdict: "RunVerdict", title: str) -> None:
    """Print a run's verdict with its statement, the checks, the figures that it has, and what to do next."""
    console.print(f"{mark_verdict(verdict.verdict, loud=True)}  {escape(title)}\n")
    show_checks(verdict)
    console.print()
    show_figures(verdict.figures)
    console.print()
    show_next(verdict.folder)


def show_figures(figures: "Figures") -> None:
    """Print the main figures of a run."""
    from hil.figures.text import main_figures

    console.print(figure_table(None, main_figures(figures)))


def show_next(out: Path) -> None:
    """Print the commands and the page with which a person goes on from a run, as far as it has a log."""

    place = shlex.quote(str(out))
    steps = {
        "look at every signal": (RunFile.LOG, f"vibrohil view {place}"),
        "verdict on one page": (RunFile.REPORT, f"{out}/report.html"),
        "all figures": (RunFile.LOG, f"vibrohil inspect {place} --all"),
    }
    for name, (file, what) in steps.items():
        if not (out / file).exists():
            continue
        console.print(f"[dim]{name + ':':22}[/]{escape(what)}", soft_wrap=True)


def show_checks(verdict: "RunVerdict") -> None:
    """Print a run's checks, those that have not passed first, and what the verdict says about them."""
    from hil.figures.gaps import longest_gaps, longest_holds

    figures = verdict.figures
    columns = (Column(title, no_wrap=True) for title in ("value", "limit", ""))
    checks = table_of((Column("check", overflow="fold"), *columns))
    for check in verdict.by_gravity:
        plain = (check.name, figure(check.value, check.unit), figure(check.limit, check.unit))
        checks.add_row(*map(escape, plain), mark_verdict(check.verdict))
    if verdict.checks:
        console.print(checks)
    for reason in verdict.reasons_of_checks:
        console.print(f"[red]{escape(reason)}[/]")
    latched = figures.latched
    if not verdict.passed and latched.at_s is not None:
        held_up = (
            ""
            if figures.clock == "lockstep"
            else "; the longest that loops were held up just before it: "
            f"firmware {figure(latched.firmware_held_ms)} ms, plant {figure(latched.plant_held_ms)} ms"
        )
        console.print(f"latched fault {figures.fault} at {figure(latched.at_s)} s{held_up}")
    for effect in verdict.faults:
        if effect.acted_on is not None:
            times = "once" if effect.acted_on == 1 else f"{effect.acted_on:,} times"
            console.print(f"[dim]injected fault {effect.kind} at {effect.at_s:g} s acted {times}[/]")
    if holds := longest_holds(figures.time_held):
        console.print(f"time was held, longest: {escape('; '.join(holds))}")
    for gap in longest_gaps(figures.gaps):
        console.print(f"[yellow]{escape(gap)}[/]")
    if verdict.lost_frames is not None:
        console.print(f"[yellow]{escape(verdict.lost_frames)}[/]")
    doubts = [f"not judged: {reason}" for reason in verdict.not_judged]
    for reason in [*verdict.reasons, *doubts]:
        console.print(f"[bold red]{escape(reason)}[/]")
