"""The program's options by the type of their value."""

from typing import Any

import typer

from tools import cli
from tools.dev.reference import every_command


def options_of(kind: str) -> list[tuple[str, str]]:
    """Every option or argument whose type mentions `kind`: command, option."""
    program: Any = typer.main.get_command(cli.program())
    return [
        (name, option.opts[0])
        for name, command in every_command(program)
        for option in command.params
        if option.type_descriptor and kind in repr(option.type_descriptor.annotation)
    ]
