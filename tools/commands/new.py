"""`vibrohil new NAME`: a commented scenario to begin with."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json
from tools.commands.places import refuse_existing
from tools.output import BadInputError, answer, console

TEMPLATE = Path(__file__).with_name("scenario_to_write.toml")


def new(
    name: Annotated[str, typer.Argument(help="Name of the scenario: the file's name, without .toml.")],
    as_json: Json = False,
) -> None:
    """Write a commented scenario, which passes as it stands, to NAME.toml, and never over a file."""
    if not name.removesuffix(".toml").strip(".") or any(part in name for part in "/\\\0"):
        raise BadInputError(f"{name!r} is no file's name; give a name without a folder, e.g. soft-spring")
    path = Path(f"{name.removesuffix('.toml')}.toml")
    refuse_existing("NAME", path)
    text = TEMPLATE.read_text("utf-8").replace("NAME.toml", path.name)
    with path.open("x", encoding="utf-8") as file:
        file.write(text)
    run = f"vibrohil run {shlex.quote(str(path))} --clock lockstep"
    answer(
        {"scenario": str(path), "run": run},
        as_json,
        lambda: console.print(f"written: {path}\n{run}", markup=False),
    )
