"""`vibrohil kernel -- COMMAND`: a real vcan where the kernel has none."""

from typing import Annotated

import typer

from tools.output import BadInputError

SETTINGS = {"ignore_unknown_options": True}
"""What follows the command's own options belongs to the command that it runs."""


def kernel(
    command: Annotated[list[str] | None, typer.Argument(help="The command to run, after --.")] = None,
    memory: Annotated[
        str | None,
        typer.Option(help="Memory of the guest kernel, 4G unless given; traces may take half of it."),
    ] = None,
) -> None:
    """Run COMMAND under user-mode Linux with a real vcan0; its exit status is the command's."""
    from hil.kernel.user_mode_linux import run_in_kernel

    if not command:
        raise BadInputError(
            "no command given; wanted e.g. vibrohil kernel -- vibrohil run soft-start-multistable --bus vcan"
        )
    raise typer.Exit(run_in_kernel(command, memory=memory))
