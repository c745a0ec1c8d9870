"""`vibrohil fuzz`: frames and files that nobody should give, kills at any moment; no harm comes of them."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Annotated, Any, Literal

import typer

from tools.commands.options import Json
from tools.output import EXIT_CHECK_FAILED, BadInputError, console, figure_table, print_json
from tools.progress import counted_progress

fuzz = typer.Typer(
    name="fuzz", help="Treat the program badly at random; a seed repeats it.", no_args_is_help=True
)


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.add_typer(fuzz)


def progress_of(what: str, count: int) -> AbstractContextManager[Callable[[int], None]]:
    """How many are done; refuses a count below 1."""
    if count < 1:
        raise BadInputError(f"--count: got {count}, wanted at least 1")
    return counted_progress(what, count)


@fuzz.command()
def frames(
    count: Annotated[int, typer.Option(help="Frames at the two inputs together.")] = 1_000_000,
    seed: Annotated[int, typer.Option(help="Of the first life; each next one has the next seed.")] = 1,
    as_json: Json = False,
) -> None:
    """Throw random and mutated frames at firmware and plant while they do their work.

    No exception, no torque beyond its limit, every frame accounted for; a failure names the seed that repeats
    it. Ten million frames take some minutes.
    """
    from tools.fuzz import frames as core

    with progress_of("frames", count) as progress:
        outcome = core.fuzz(count, seed, progress)
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


@fuzz.command()
def scenes(
    count: Annotated[int, typer.Option(help="Inputs.")] = 2500,
    seed: Annotated[int, typer.Option(help="Of the first input; each next one has the next.", min=0)] = 1,
    as_json: Json = False,
) -> None:
    """Give scenes, scenarios, parameter files and settings that are damaged at random.

    Each has to end with a verdict or in a sentence: no traceback, at most 20 s and 2 GB, no file touched
    but its own, nothing left behind.
    """
    fuzz_inputs("scenes", count, seed, as_json)


@fuzz.command()
def files(
    count: Annotated[int, typer.Option(help="Inputs.")] = 2500,
    seed: Annotated[int, typer.Option(help="Of the first input; each next one has the next.", min=0)] = 1,
    as_json: Json = False,
) -> None:
    """Give run folders, logs, traces and CAN logs that are damaged at random to the commands that read them.

    Each has to end with a verdict or in a sentence: no traceback, at most 20 s and 2 GB, no file touched
    but its own, nothing left behind.
    """
    fuzz_inputs("files", count, seed, as_json)


def fuzz_inputs(kind: Literal["scenes", "files"], count: int, seed: int, as_json: bool) -> None:
    """Run the cases and print what they came to."""
    from tools.fuzz import inputs as core

    with progress_of(kind, count) as progress:
        outcome = core.fuzz(kind, count, seed, progress)
    failures = [failure._asdict() for failure in outcome.failures]
    if as_json:
        print_json({**outcome._asdict(), "failures": failures, "seed": seed, "passed": not failures})
    else:
        rows: list[tuple[str, Any, str]] = [
            ("inputs", f"{outcome.inputs:,}, seeds {seed} to {seed + outcome.inputs - 1}", ""),
            *((f"  {case}", f"{number:,}", "") for case, number in outcome.cases.items()),
            *((f"exit status {status}", number, "") for status, number in sorted(outcome.statuses.items())),
            ("slowest", outcome.slowest_s, "s of processor time"),
            ("largest memory", outcome.largest_mb, "MB"),
        ]
        console.print(figure_table(f"fuzz {kind}", rows))
        for failure in outcome.failures:
            console.print(f"[red]seed {failure.seed}[/]", end=" ")
            said = f"({failure.case}) vibrohil {' '.join(failure.arguments)}: {failure.what}"
            console.print(said, markup=False, highlight=False)
        console.print("[red]failed[/]" if failures else "[green]passed[/]")
    if failures:
        raise typer.Exit(EXIT_CHECK_FAILED)


@fuzz.command()
def kills(
    count: Annotated[int, typer.Option(help="Runs that are killed.")] = 200,
    seed: Annotated[int, typer.Option(help="Of their order and moments.")] = 1,
    as_json: Json = False,
) -> None:
    """Send each process of a run each signal that ends or stops it, at each stage, also while it is judged.

    So it does with suites, campaigns and their workers. After 2 s no process, socket or temporary file is
    left; the log verifies; the verdict names the cause; what was finished is kept. 200 kills take about an
    hour.
    """
    from tools.fuzz.kills import fuzz_kills

    with progress_of("kills", count) as progress:
        failures = fuzz_kills(count, seed, progress)
    passed = not failures
    if as_json:
        found = [{"kill": str(one.kill), "what": one.what} for one in failures]
        print_json({"kills": count, "seed": seed, "failures": found, "passed": passed})
    else:
        for one in failures:
            console.print(f"[red]{one.kill}[/]: {'; '.join(one.what)}", highlight=False)
        console.print(f"{count} kills, seed {seed}: " + ("passed" if passed else f"{len(failures)} failures"))
    if not passed:
        raise typer.Exit(EXIT_CHECK_FAILED)
