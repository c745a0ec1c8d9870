"""`vibrohil list`: the names of scenarios, sets of checks, scenes, kinds of faults and parameters."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, get_args

import typer
from rich.markup import escape
from rich.table import Column

from plant_sim.synonyms import with_synonyms
from tools.commands.options import Json
from tools.output import BadInputError, answer, console, figure, table_of


class Named(NamedTuple):
    """A name for the command line with its group, its most important value, and what it is."""

    name: str
    group: str
    value: str
    title: str


def list_names(
    what: Annotated[
        Literal["scenarios", "check-sets", "scenes", "faults", "parameters"],
        typer.Argument(help="The kind of names to list."),
    ] = "scenarios",
    group: Annotated[str | None, typer.Option(help="Only this group: the table's second column.")] = None,
    find: Annotated[
        str | None, typer.Option(help="Only names and titles that contain this text or a synonym of it.")
    ] = None,
    shown: Annotated[
        str | None,
        typer.Option(
            "--show",
            metavar="NAME",
            help="Print this scenario (name, FILE or FILE::CASE) as TOML, with all that its file refers to; "
            "after `list check-sets` or `list scenes`, this set or scene.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """List scenarios (with group and duration), scenes (drive, stop), faults (place, keys) or parameters."""
    if shown is not None:
        show_tables(what, shown, as_json)
        return
    names = {
        "scenarios": scenarios,
        "check-sets": sets,
        "scenes": scenes,
        "faults": faults,
        "parameters": parameters,
    }
    every = list(names[what]())
    if group in names:
        raise BadInputError(f"--group {group}: these are a kind of names: vibrohil list {group}")
    found = choose(every, group, find)
    answer({what: [one._asdict() for one in found]}, as_json, lambda: show(found, len(every)))


def choose(every: Sequence[Named], group: str | None, text: str | None) -> list[Named]:
    """The names of a group that contain a text; BadInputError for an unknown group or if there is none."""
    groups = sorted({one.group for one in every})
    if group is not None and group not in groups:
        raise BadInputError(f"--group {group}: no such group; the groups are {', '.join(groups)}")
    within = [one for one in every if group in (None, one.group)]
    wanted = with_synonyms(text or "")
    found = [one for one in within if any(word in f"{one.name} {one.title}".lower() for word in wanted)]
    if not found:
        raise BadInputError(
            f"--find {text!r}: none of {len(within)} names and titles contains it or a synonym"
        )
    return found


BESIDE_NAMES = 55
"""Characters beside the longest name that the other three columns want."""


def show(found: Sequence[Named], count: int) -> None:
    """Print the names in four columns; where these are too narrow, each name above its title, unbroken."""
    group, value = Column(no_wrap=True), Column(no_wrap=True, justify="right")
    rows = [Named(*map(escape, one)) for one in found]
    if max(len(one.name) for one in found) + BESIDE_NAMES > console.width:
        table = table_of(
            (group, value, Column(overflow="fold")),
            ((one.group, one.value, f"[cyan]{one.name}[/]\n{one.title}") for one in rows),
            show_header=False,
        )
    else:
        columns = (Column(style="cyan", no_wrap=True), group, value, Column(overflow="fold"))
        table = table_of(columns, rows, show_header=False)
    console.print(table)
    if len(found) < count:
        console.print(f"{len(found)} of {count}", style="dim")


def show_tables(what: str, name: str, as_json: bool) -> None:
    """Print the complete tables of a scenario, a set of checks or a scene."""
    import tomli_w

    tables = tables_of(what, name)
    text = tomli_w.dumps(tables)
    payload = {"name": name, "tables": tables}
    answer(payload, as_json, lambda: console.print(text, markup=False, highlight=False, soft_wrap=True))


def tables_of(what: str, name: str) -> Mapping[str, Any]:
    """The complete tables behind a name; raises TextInputError."""
    if what in ("faults", "parameters"):
        raise BadInputError(f"--show: the {what} have no tables; leave it out, the list says all")
    if what == "scenes":
        from plant_sim.scene import read_scene

        return read_scene(name)
    if what == "check-sets":
        from hil.scenario.files import check_set

        return {"checks": check_set(name)}
    from hil.scenario.files import read_scenario
    from hil.scenario.scenario import check_scenario

    tables = read_scenario(name)
    check_scenario(tables, name)
    return tables


def scenarios() -> Iterator[Named]:
    """The scenarios that come with the package; their group is their folder, their value the duration."""
    from hil.scenario.files import locate, read_scenario, scenario_names

    for name in scenario_names():
        document = read_scenario(name)
        duration = figure(float(document["script"]["duration_s"]), "s")
        yield Named(name, locate(name)[0].parent.name, duration, document["title"])


def sets() -> Iterator[Named]:
    """The sets of checks that scenarios may name; their value is the number of checks."""
    from hil.scenario.files import check_sets

    for name, one in check_sets().items():
        yield Named(name, "checks", str(len(one["checks"])), one["title"])


def scenes() -> Iterator[Named]:
    """The scenes that come with the package; the first comment of each file is its title."""
    from plant_sim.scene import SCENES, read_scene, scene_names

    for name in scene_names():
        first = (SCENES / f"{name}.toml").read_text(encoding="utf-8").partition("\n")[0]
        tables = read_scene(name)
        stop = tables.get("stop", {}).get("law", "no stop")
        yield Named(name, tables["drive"]["model"], stop, first.removeprefix("#").strip())


def faults() -> Iterator[Named]:
    """The kinds of faults; their group is where they act, their value the keys of their own."""
    from hil.faults.every import KINDS
    from hil.faults.fault import Fault

    for one in KINDS:
        own = ", ".join(key for key in one.model_fields if key not in Fault.model_fields)
        title = (one.__doc__ or "").partition("\n")[0]
        (place,) = re.findall(r"^\w+ (?:the )?(\w+)", one.place)
        yield Named(get_args(one.model_fields["kind"].annotation)[0], place, own, title)


def parameters() -> Iterator[Named]:
    """The firmware's parameters; their group is the part of their name before the dot."""
    from firmware_py.interface.parameter_table import TABLE

    for one in TABLE:
        yield Named(one.name, one.name.partition(".")[0], figure(float(one.default), one.unit), one.meaning)
