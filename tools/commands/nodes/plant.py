"""`vibrohil plant`: the simulated module alone, on any bus."""

from pathlib import Path
from typing import Annotated

import typer

from tools.outputs import folder_option


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(plant)


def plant(
    scenario: Annotated[str, typer.Argument(help="The scenario whose scene to simulate.")],
    bus: Annotated[str, typer.Option(help="The bus to join, e.g. socketcan:can0 or local:PATH.")] = "auto",
    out: Annotated[Path | None, folder_option("A run folder for the traces; none without it.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.", min=0)] = 1,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a value of the scene: scene.…=VALUE; repeatable."),
    ] = None,
    sync: Annotated[
        bool, typer.Option(help="Print 'ready', then wait for the common start time on standard input.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="With --sync: join when requested, and continue the trace.")
    ] = False,
    until: Annotated[float | None, typer.Option(help="Stop after so many seconds; else on Ctrl-C.")] = None,
) -> None:
    """Run the simulated module, its drive and its sensors as one CAN node at 1 kHz."""
    from hil.nodes.main import plant_main

    plant_main(
        scenario,
        settings=change or [],
        bus=bus,
        out_dir=out,
        seed=seed,
        sync=sync,
        until_s=until,
        again=again,
    )
