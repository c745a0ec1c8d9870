"""`vibrohil operator`: a scenario's commands alone, on any bus."""

from typing import Annotated

import typer

from tools.commands.options import NodeBus


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(operator)


def operator(
    scenario: Annotated[str, typer.Argument(help="The scenario whose script to play.")],
    bus: NodeBus = "auto",
    change: Annotated[
        list[str] | None, typer.Option("--set", help="Change a value: script.…=VALUE; repeatable.")
    ] = None,
) -> None:
    """Play the operator of a scenario as one CAN node; Ctrl-C sends an E-stop and ends.

    At the end of the script it falls silent, and a firmware that still moves stops by its watchdog.
    """
    from hil.nodes.main import operator_main

    operator_main(scenario, settings=change or [], bus=bus)
