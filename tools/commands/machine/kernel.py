"""`vibrohil kernel -- COMMAND`: a real vcan where the kernel has none."""

from typing import Annotated

import typer

from tools.output import BadInputError


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(context_settings={"ignore_unknown_options": True})(kernel)


def kernel(
    command: Annotated[list[str] | None, typer.Argument(help="The command to run, after --.")] = None,
    memory: Annotated[
        str | None,
        typer.Option(help="Memory of the guest kernel, 4G unless given; traces may take half of it."),
    ] = None,
) -> None:
    """Run COMMAND under user-mode Linux with a real vcan0; its exit status is the command's."""
    from hil.bus.uml import run_in_kernel

    if not command:
        raise BadInputError(
            "no command given; wanted e.g. vibrohil kernel -- vibrohil run soft-start-multistable --bus vcan"
        )
    raise typer.Exit(run_in_kernel(command, memory=memory))
