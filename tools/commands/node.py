"""`vibrohil node`: a node of the roster as a process of a run, which starts it."""

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Controller, NodeBus, Until
from tools.commands.places import folder_option


def node(
    name: Annotated[str, typer.Argument(help="The node, e.g. plant.")],
    scenario: Annotated[str, typer.Argument(help="The scenario as run.")],
    out: Annotated[Path, folder_option("The run folder.")],
    seed: Annotated[int, typer.Option(help="Seed of the run.", min=0)] = 1,
    bus: NodeBus = "auto",
    firmware: Controller = "compiled",
    until: Until = None,
    again: Annotated[
        bool, typer.Option("--again", help="Join when requested, and continue the trace.")
    ] = False,
    turns: Annotated[
        Path | None, typer.Option(help="The socket of the pacemaker, which gives the node its turns.")
    ] = None,
) -> None:
    """Print 'ready', wait for the start on standard input, and run a node of a run."""
    from hil.nodes.main import NodeProcess, node_main

    process = NodeProcess(bus, out, seed, until, sync=True, again=again, turns=turns)
    node_main(name, scenario, (), process, firmware)
