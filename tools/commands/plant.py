"""`vibrohil plant`: the simulated module alone, on any bus."""

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Change, NodeBus, Until
from tools.commands.places import folder_option


def plant(
    scenario: Annotated[str, typer.Argument(help="The scenario with the scene.")],
    bus: NodeBus = "auto",
    out: Annotated[Path | None, folder_option("A run folder for the traces; by default none.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.", min=0)] = 1,
    change: Change = None,
    until: Until = None,
) -> None:
    """Run the simulated module, its drive and its sensors as one CAN node at 1 kHz."""
    from hil.nodes.main import NodeProcess, node_main

    node_main("plant", scenario, change or [], NodeProcess(bus, out, seed, until))
