"""`vibrohil import LOG`: a CAN log of a real bench in the layout of a run."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from tools.commands.options import Json
from tools.output import answer, console, figure_table
from tools.outputs import folder_option


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
    """Make a run folder from a CAN log, to view and inspect like a run, but without truth."""
    from tools.logs.importing import import_log as make_run

    result = make_run(log, out, channel, tolerant)
    answer(result, as_json, lambda: show(result))


def show(result: dict[str, Any]) -> None:
    """Print the contents of the log, and the frames that could not be shown."""
    rows = [
        ("duration", result["duration_s"], "s"),
        ("frames", result["frames"], ""),
        ("shown as signals", result["known"], ""),
        *((f"{name} is not in the DBC", number, "frames") for name, number in result["unknown"].items()),
        *((f"{name} is not valid", number, "frames") for name, number in result["refused"].items()),
        *((f"left out: {kind}", number, "frames") for kind, number in result["skipped"].items()),
    ]
    console.print(figure_table(result["log"], rows))
    for name, number in result["other_objects"].items():
        console.print(f"left out: {number} objects of another kind ({escape(name)})")
    if result["ignored"]:
        first = result["ignored_lines"][0]
        console.print(
            f"{result['ignored']} lines are no CAN messages, the first of them line {first['number']}: "
            f"{escape(first['text'])}",
            soft_wrap=True,
        )
    if result["clock_jumps"]:
        place, from_s, to_s = result["clock_jumps_first"][0].values()
        console.print(
            f"[yellow]{result['clock_jumps']} jumps of the clock or silences of the bus[/], the first at "
            f"line or message {place}: from {from_s:.6f} to {to_s:.6f} s",
            soft_wrap=True,
        )
    for line in result["left_out"]:
        console.print(f"[yellow]left out line {line['number']}[/]: {escape(line['why'])}", soft_wrap=True)
    if result["truncated"] is not None:
        console.print(f"[yellow]the log is cut short[/]: {escape(result['truncated'])}")
    if not result["firmware_seen"]:
        console.print("no heartbeat of the firmware: neither modes nor estimate are shown")
    console.print(f"open it with: vibrohil view {escape(result['out'])}", soft_wrap=True)
