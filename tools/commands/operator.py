"""`vibrohil operator`: a scenario's commands alone, on any bus."""

from typing import Annotated

import typer

from tools.commands.options import Change, NodeBus


def operator(
    scenario: Annotated[str, typer.Argument(help="The scenario with the script.")],
    bus: NodeBus = "auto",
    change: Change = None,
) -> None:
    """Send a scenario's commands as one CAN node; Ctrl-C sends an E-stop and ends.

    An E-stop is repeated until the firmware confirms it; exit status 1 if it does not within two seconds.

    At the end of the script the operator sends no more commands, and the firmware stops the module.
    """
    from hil.nodes.main import operator_main

    if not operator_main(scenario, settings=change or [], bus=bus):
        raise typer.Exit(1)
