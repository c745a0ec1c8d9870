"""`vibrohil import LOG`: a CAN log of a real bench in the layout of a run."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from tools.commands.options import Json
from tools.commands.places import folder_option
from tools.output import EXIT_NOTHING_RAN, EXIT_PASSED, answer, console, show_tables


def import_log(
    log: Annotated[
        Path, typer.Argument(help="A candump .log, or .asc, .blf, .trc; the text formats also .gz.")
    ],
    out: Annotated[
        Path | None, folder_option("The run folder to make; by default a new one under runs/.")
    ] = None,
    channel: Annotated[
        str | None, typer.Option(help="The channel to read, if the log has several.", metavar="NAME")
    ] = None,
    tolerant: Annotated[
        bool, typer.Option("--tolerant", help="Skip unreadable lines, and list them.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Make a run folder from a CAN log, to view and inspect like a run, but without truth.

    Its times count from the first frame. Exit status 5 if it must not be judged: more than a hundredth of its
    lines are no messages, its clock falls back, or two firmwares have sent with the same numbers.
    """
    from tools.exchange.importing import import_log as make_run

    result = make_run(log, out, channel, tolerant)
    status = EXIT_NOTHING_RAN if result["not_judged"] else EXIT_PASSED
    answer(result, as_json, lambda: show(result), status)


def show(result: dict[str, Any]) -> None:
    """Print what the log has, and how to look at it."""
    show_tables(result)
    place = escape(shlex.quote(result["out"]))
    console.print(f"[dim]open it with:[/] vibrohil view {place}", soft_wrap=True)
