"""`vibrohil list`: the names of scenarios, scenes and firmware parameters."""

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import typer
from rich.table import Column

from tools.commands.options import Json
from tools.output import answer, console, table_of


class Named(NamedTuple):
    """A name for the command line, with its title."""

    name: str
    title: str


def list_names(
    what: Annotated[
        Literal["scenarios", "scenes", "parameters"], typer.Argument(help="The kind of names to list.")
    ] = "scenarios",
    as_json: Json = False,
) -> None:
    """List the scenarios, the scenes or the firmware's parameters, each with its title."""
    found = list({"scenarios": scenarios, "scenes": scenes, "parameters": parameters}[what]())
    columns = (Column(style="cyan", no_wrap=True), Column(overflow="fold"))
    table = table_of(columns, found, show_header=False)
    answer({what: [one._asdict() for one in found]}, as_json, lambda: console.print(table))


def scenarios() -> Iterator[Named]:
    """The scenarios that come with the package."""
    from hil.scenario.scenario import read_scenario, scenario_names

    for name in scenario_names():
        yield Named(name, read_scenario(name)["title"])


def scenes() -> Iterator[Named]:
    """The scenes that come with the package; the first comment of each file is its title."""
    from plant_sim.scene import SCENES, scene_names

    for name in scene_names():
        first = (SCENES / f"{name}.toml").read_text(encoding="utf-8").partition("\n")[0]
        yield Named(name, first.removeprefix("#").strip())


def parameters() -> Iterator[Named]:
    """The firmware's parameters."""
    from firmware_py.interface.sources.parameter_table import TABLE
    from firmware_py.shell.parameters import DIMENSIONLESS

    for one in TABLE:
        unit = "" if one.unit == DIMENSIONLESS else f" {one.unit}"
        yield Named(one.name, f"{one.default:g}{unit}: {one.meaning}")
