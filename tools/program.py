"""The program `vibrohil`: its commands, in the groups of the help page."""

import functools
import inspect
import os
import re
from collections.abc import Callable
from contextlib import chdir
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from tools.commands.node import node
from tools.examples import EXAMPLES
from tools.output import BadInputError


def print_version(wanted: bool) -> None:
    """Print the version and the commit of the code, and exit."""
    if not wanted:
        return
    from hil.record.provenance import commit, versions

    origin = commit()
    edited = ", edited since" if origin["edited"] else ""
    place = f" ({origin['commit'][:12]}{edited})" if origin["commit"] else ""
    typer.echo(f"vibrohil {versions()['vibrohil']}{place}")
    raise typer.Exit


COMMANDS = {
    "Test the firmware": ("new", "run", "suite", "campaign", "falsify"),
    "Look at runs": ("runs", "view", "why", "inspect", "compare", "replay", "import_log", "export"),
    "Design": ("tune", "trade", "schedule"),
    "The module alone": ("simulate", "study", "export_fmu"),
    "One node on a bus": ("bring_up", "firmware", "plant", "operator", "measure", "calibrate"),
    "This machine": ("doctor", "kernel", "list_names"),
}
"""The modules of the commands, in the groups of the help page."""
OTHER_NAMES = {"import_log": "import", "list_names": "list"}
"""`import` and `list` are words of Python, so the modules of these commands have a longer name."""
NUMBA_SETTINGS, MATPLOTLIB_SETTINGS = ".numba_config.yaml", "matplotlibrc"


def name_of(module: str) -> str:
    """The name of a module's command."""
    return OTHER_NAMES.get(module, module.replace("_", "-"))


def add(app: typer.Typer, module: str, group: str) -> None:
    """Add one module's command, or its group of sub-commands, to the program."""
    name = name_of(module)
    loaded = import_module(f"tools.commands.{module}")
    command = getattr(loaded, module)
    if not isinstance(command, typer.Typer):
        settings = getattr(loaded, "SETTINGS", None)
        text, epilog = flowing(command), example(name)
        app.command(name, help=text, context_settings=settings, rich_help_panel=group, epilog=epilog)(command)
        return
    app.add_typer(command, rich_help_panel=group, epilog=example(name) if name in EXAMPLES else None)
    for sub_command in command.registered_commands:
        sub_name = sub_command.name or getattr(sub_command.callback, "__name__", "")
        sub_command.epilog = example(f"{name} {sub_name}")
        sub_command.help = flowing(sub_command.callback)


def flowing(command: Callable[..., Any] | None) -> str:
    """A command's docstring, each paragraph and each item of a list in one line, which the page breaks."""
    return re.sub(r"(?<!\n)\n(?!\n|- )", " ", inspect.cleandoc((command and command.__doc__) or ""))


def example(name: str) -> str:
    """The last line of a command's help."""
    return f"Example: {EXAMPLES[name]}"


def vibrohil(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and the commit.", callback=print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Hardware-in-the-loop bench for a vibro-impact drive."""


@functools.cache
def program(wanted: str = "") -> TyperGroup:
    """The program with the wanted command alone, so that it starts at once; with all if none has this name.

    Raises KernelCacheError if the kernels' folder cannot be written.
    """
    app = typer.Typer(name="vibrohil", no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(vibrohil)
    grouped = [(module, group) for group, modules in COMMANDS.items() for module in modules]
    alone = [(module, group) for module, group in grouped if name_of(module) == wanted]
    for module, group in alone or grouped:
        add(app, module, group)
    app.command(hidden=True)(node)
    command: Any = typer.main.get_command(app)  # its type lacks the sub-commands
    return command  # type: ignore[no-any-return]


def check_surroundings(arguments: list[str]) -> None:
    """Raise BadInputError for a current folder that was removed or has settings of numba, or for other bytes.

    Modules and paths are looked up in this folder, numba would compile by its settings, and no log could hold
    an argument (e.g. a path) that is not valid UTF-8. Settings of matplotlib are passed over: it is imported
    elsewhere, because it would read them first.
    """
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise BadInputError("the current folder was removed; change to another folder") from error
    if os.path.lexists(NUMBA_SETTINGS):
        raise BadInputError(
            f"the current folder holds {NUMBA_SETTINGS}, and numba would compile by its settings; "
            "remove it, or start in another folder (settings of your own: the variables NUMBA_…)"
        )
    if os.path.lexists(MATPLOTLIB_SETTINGS):
        with chdir(Path(__file__).parent):
            import_module("matplotlib")
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise BadInputError(f"{argument!a} is not valid UTF-8; give paths and values that are") from error
