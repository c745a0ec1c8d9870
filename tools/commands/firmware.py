"""`vibrohil firmware`: the controller alone, on any bus."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from tools.outputs import folder_option


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(firmware)


def firmware(
    scenario: Annotated[
        str | None,
        typer.Argument(help="A scenario whose firmware parameters to run with; the defaults without one."),
    ] = None,
    bus: Annotated[str, typer.Option(help="The bus to join, e.g. socketcan:can0 or local:PATH.")] = "auto",
    build: Annotated[
        Literal["python", "compiled"],
        typer.Option("--firmware", help="The firmware's build: interpreted, or compiled by numba."),
    ] = "python",
    out: Annotated[Path | None, folder_option("A run folder for the trace; none without it.")] = None,
    change: Annotated[
        list[str] | None, typer.Option("--set", help="Change a parameter: firmware.NAME=VALUE; repeatable.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of what faults break at random.", min=0)] = 1,
    sync: Annotated[
        bool, typer.Option(help="Print 'ready', then wait for the common start time on standard input.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="With --sync: join when requested, and continue the trace.")
    ] = False,
    until: Annotated[float | None, typer.Option(help="Stop after so many seconds; else on Ctrl-C.")] = None,
) -> None:
    """Run the controller as one CAN node at 1 kHz."""
    from hil.node_main import firmware_main

    firmware_main(
        scenario,
        settings=change or [],
        bus=bus,
        out_dir=out,
        seed=seed,
        sync=sync,
        until_s=until,
        again=again,
        build=build,
    )
