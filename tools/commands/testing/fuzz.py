"""`vibrohil fuzz`: invalid frames and files, and kills at any time, must do no harm."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Annotated, Any, Literal

import typer

from tools.commands.options import Json
from tools.output import BadInputError, answer, console, exit_of, figure_table
from tools.progress import counted_progress

fuzz = typer.Typer(
    name="fuzz",
    help="Test the program with random invalid input and kills; a seed repeats a test.",
    no_args_is_help=True,
)

Inputs = Annotated[int, typer.Option(help="Number of inputs.")]
FirstSeed = Annotated[
    int, typer.Option(help="Seed of the first input; each further input has the next seed.", min=0)
]


def progress_of(what: str, count: int) -> AbstractContextManager[Callable[[int], None]]:
    """A progress bar over `count` cases; raises BadInputError for a count below 1."""
    if count < 1:
        raise BadInputError(f"--count: got {count}, wanted at least 1")
    return counted_progress(what, count)


@fuzz.command()
def frames(
    count: Annotated[int, typer.Option(help="Number of frames at both inputs together.")] = 1_000_000,
    seed: Annotated[
        int, typer.Option(help="Seed of the first loop; each further loop has the next seed.")
    ] = 1,
    as_json: Json = False,
) -> None:
    """Send random and mutated frames to a running firmware and plant.

    The test requires no exception, no torque beyond its limit, and a count of every frame. A failure names
    the seed that repeats it. Ten million frames take some minutes.
    """
    from tools.fuzz import frames as core

    with progress_of("frames", count) as progress:
        outcome = core.fuzz(count, seed, progress)
    failures = [failure._asdict() for failure in outcome.failures]
    rows = [
        ("frames", f"{outcome.frames:,}", ""),
        ("accepted", f"{outcome.taken:,}", ""),
        ("rejected with a reason", f"{outcome.dropped:,}", ""),
        ("without a receiver", f"{outcome.not_addressed:,}", ""),
        ("ticks", f"{outcome.ticks:,}", ""),
        ("ticks with torque", f"{outcome.ticks_with_torque:,}", ""),
        ("largest torque, firmware", outcome.firmware_torque_n_m, "N m"),
        ("largest torque, drive", outcome.drive_torque_n_m, "N m"),
    ]

    def show() -> None:
        console.print(figure_table("fuzz", rows))
        for failure in outcome.failures:
            console.print(f"[red]seed {failure.seed}, tick {failure.tick}[/]: {failure.what}")
        console.print(f"[red]{len(failures)} failures[/]" if failures else "[green]passed[/]")

    payload = {**outcome._asdict(), "failures": failures, "passed": not failures}
    answer(payload, as_json, show, exit_of(payload))


ENDS = (
    "Each command must end with a verdict or one sentence: no traceback, at most 20 s and 2 GB, no file "
    "changed but its own, no temporary file left."
)


@fuzz.command(help=f"Read randomly damaged scenes, scenarios, parameter files and settings.\n\n{ENDS}")
def scenes(count: Inputs = 2500, seed: FirstSeed = 1, as_json: Json = False) -> None:
    """`vibrohil fuzz scenes`."""
    fuzz_inputs("scenes", count, seed, as_json)


@fuzz.command(help=f"Read randomly damaged run folders, logs, traces and CAN logs.\n\n{ENDS}")
def files(count: Inputs = 2500, seed: FirstSeed = 1, as_json: Json = False) -> None:
    """`vibrohil fuzz files`."""
    fuzz_inputs("files", count, seed, as_json)


def fuzz_inputs(kind: Literal["scenes", "files"], count: int, seed: int, as_json: bool) -> None:
    """Run the cases and print the results."""
    from tools.fuzz import inputs as core

    with progress_of(kind, count) as progress:
        outcome = core.fuzz(kind, count, seed, progress)
    failures = [failure._asdict() for failure in outcome.failures]
    rows: list[tuple[str, Any, str]] = [
        ("inputs", f"{outcome.inputs:,}, seeds {seed} to {seed + outcome.inputs - 1}", ""),
        *((f"  {case}", f"{number:,}", "") for case, number in outcome.cases.items()),
        *((f"exit status {status}", number, "") for status, number in sorted(outcome.statuses.items())),
        ("slowest", outcome.slowest_s, "s of processor time"),
        ("largest memory", outcome.largest_mb, "MB"),
    ]

    def show() -> None:
        console.print(figure_table(f"fuzz {kind}", rows))
        for failure in outcome.failures:
            console.print(f"[red]seed {failure.seed}[/]", end=" ")
            said = f"({failure.case}) vibrohil {' '.join(failure.arguments)}: {failure.what}"
            console.print(said, markup=False)
        console.print("[red]failed[/]" if failures else "[green]passed[/]")

    payload = {**outcome._asdict(), "failures": failures, "seed": seed, "passed": not failures}
    answer(payload, as_json, show, exit_of(payload))


@fuzz.command()
def kills(
    count: Annotated[int, typer.Option(help="Number of kills.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of their order and times.")] = 1,
    as_json: Json = False,
) -> None:
    """Send each signal that ends or stops a process to each process of a run, at each stage.

    The command also kills suites, campaigns and their workers. After 2 s no process, socket or temporary
    file may be left. The log must verify, the verdict must name the cause, and finished runs must be kept.
    200 kills take about an hour.
    """
    from tools.fuzz.kills import fuzz_kills

    with progress_of("kills", count) as progress:
        failures = fuzz_kills(count, seed, progress)

    def show() -> None:
        for one in failures:
            console.print(f"[red]{one.kill}[/]: {'; '.join(one.what)}")
        result = f"{len(failures)} failures" if failures else "passed"
        console.print(f"{count} kills, seed {seed}: {result}")

    found = [{"kill": str(one.kill), "what": one.what} for one in failures]
    payload = {"kills": count, "seed": seed, "failures": found, "passed": not failures}
    answer(payload, as_json, show, exit_of(payload))
