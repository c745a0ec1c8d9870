"""The program's options by the type of their value."""

from tools.dev.command_page import every_command
from tools.program import program


def options_of(kind: str) -> list[tuple[str, str]]:
    """Every option or argument whose type mentions `kind`: command, option."""
    return [
        (name, option.opts[0])
        for name, command in every_command(program())
        for option in command.params
        if option.type_descriptor and kind in repr(option.type_descriptor.annotation)
    ]
