"""`vibrohil fuzz`: millions of frames that nobody should send, and nothing bad comes of them."""

from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tools.output import EXIT_CHECK_FAILED, BadInputError, console, figure_table, print_json, progress_console


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(fuzz)


def fuzz(
    frames: Annotated[int, typer.Option(help="Frames at the two inputs together.")] = 1_000_000,
    seed: Annotated[int, typer.Option(help="Of the first life; each next one has the next seed.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Throw random and mutated frames at firmware and plant while they do their work.

    No exception, no torque beyond its limit, every frame accounted for; a failure names the seed that repeats
    it. Ten million frames take some minutes.
    """
    from tools import fuzz as core

    if frames < 1:
        raise BadInputError(f"--frames: got {frames}, wanted at least 1")
    with Progress(
        TextColumn("frames"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=progress_console,
        disable=as_json,
        transient=True,
    ) as bar:
        task = bar.add_task("frames", total=frames)
        outcome = core.fuzz(frames, seed, lambda done: bar.update(task, completed=done))
    failures = [failure._asdict() for failure in outcome.failures]
    passed = not failures
    if as_json:
        print_json({**outcome._asdict(), "failures": failures, "passed": passed})
    else:
        rows = [
            ("frames", f"{outcome.frames:,}", ""),
            ("taken", f"{outcome.taken:,}", ""),
            ("dropped for a reason", f"{outcome.dropped:,}", ""),
            ("for nobody there", f"{outcome.not_addressed:,}", ""),
            ("ticks", f"{outcome.ticks:,}", ""),
            ("of them with torque", f"{outcome.ticks_with_torque:,}", ""),
            ("largest torque, firmware", outcome.firmware_torque_n_m, "N m"),
            ("largest torque, drive", outcome.drive_torque_n_m, "N m"),
        ]
        console.print(figure_table("fuzz", rows))
        for failure in outcome.failures:
            console.print(f"[red]seed {failure.seed}, tick {failure.tick}[/]: {failure.what}")
        console.print("[green]passed[/]" if passed else f"[red]{len(failures)} failures[/]")
    if not passed:
        raise typer.Exit(EXIT_CHECK_FAILED)
