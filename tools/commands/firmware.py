"""`vibrohil firmware`: the controller alone, on any bus; and its build for a board."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from tools.commands.options import Change, Controller, Json, NodeBus, Until
from tools.commands.places import folder_option
from tools.output import BadInputError, answer, console, table_of
from tools.progress import shown_progress

Scenario = Annotated[
    str | None, typer.Argument(help="A scenario with the firmware's parameters; without it the defaults.")
]


class NodeUnlessNamed(TyperGroup):
    """A group with a default command."""

    unnamed = "node"

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Insert the default command if the arguments name none."""
        is_named = args[:1] == ["--help"] or any(name in self.commands for name in args[:1])
        return super().parse_args(ctx, args if is_named else [self.unnamed, *args])


firmware = typer.Typer(
    name="firmware",
    cls=NodeUnlessNamed,
    help="The controller alone: as a node on any bus, or built for a board.",
)


@firmware.command()
def build(
    scenario: Scenario = None,
    *,
    target: Annotated[
        Literal["cortex-m7", "cortex-m4f", "host", "host-single"],
        typer.Option(
            help="The target: a Cortex-M7 with double precision, a Cortex-M4F with single precision, or this "
            "machine with either."
        ),
    ],
    out: Annotated[Path, folder_option("The folder for the object file and its headers.")],
    change: Change = None,
    as_json: Json = False,
) -> None:
    """Make an object file of the firmware, its headers and its A2L file, with gcc.

    It is the source of `firmware c`, compiled: for a board by arm-none-eabi-gcc, for this machine by gcc.

    The object follows a gait only if firmware.gait.follow is set. The command prints the bytes of the code,
    and of config and state by block. For a board, the config requires the test of the drive's watchdog before
    a start, unless firmware.watchdog.proof_required is set.
    """
    from firmware_py.builds.a2l import a2l
    from firmware_py.builds.c99.header import config_header, header
    from firmware_py.builds.c_compiler import TARGETS, measure_sizes, object_code
    from firmware_py.node.memory import file_name
    from firmware_py.shell.parameters import addresses_from, config_from, require_proof
    from hil.record.new_file import write_anew
    from tools.budget import ram_by_block

    parameters = parameters_of(scenario, change)
    config = config_from(parameters if target.startswith("host") else require_proof(parameters))
    has_gait = config.p.gait.follow > 0
    code, precision = object_code(target, has_gait), TARGETS[target].precision
    out.mkdir(parents=True, exist_ok=True)
    write_anew(out / "vibro_firmware.o", code)
    write_anew(out / "vibro_firmware.h", header(precision))
    write_anew(out / "vibro_config.h", config_header(config, precision))
    write_anew(out / f"{file_name()}.a2l", a2l(addresses_from(parameters)))
    found, parts = measure_sizes(target, has_gait), ram_by_block(precision)
    payload = {"target": target, "bytes": found, "map": parts, "out": out}
    files = f"{out}: vibro_firmware.o, vibro_firmware.h, vibro_config.h, {file_name()}.a2l"
    answer(payload, as_json, lambda: show_sizes(found, parts, files))


def parameters_of(scenario: str | None, change: list[str] | None) -> dict[str, Any]:
    """The firmware's parameters in a scenario, or without one the changed ones."""
    from hil.scenario.scenario import load_scenario
    from hil.scenario.settings import apply_settings

    if scenario is None:
        parameters: dict[str, Any] = apply_settings({"firmware": {}}, change or [])["firmware"]
        return parameters
    return load_scenario(scenario, change or []).parameters


@firmware.command()
def c(
    scenario: Scenario = None,
    *,
    out: Annotated[Path, folder_option("The folder for the source, its headers and how to compile it.")],
    precision: Annotated[
        Literal["single", "double"], typer.Option(help="The precision of all floats.")
    ] = "double",
    without_gait: Annotated[
        bool, typer.Option("--without-gait", help="Leave out the blocks that follow the wearer's gait.")
    ] = False,
    change: Change = None,
    as_json: Json = False,
) -> None:
    """Write the firmware as C99 source, with its headers and its A2L file.

    Each function has the name of its Python function, with its module's name before it. README.md names the
    compiler's options that keep the bits: compiled with them, the source sends the same frames as the other
    builds of its precision.
    """
    from firmware_py.builds.c99.emitter import emit
    from firmware_py.builds.c99.folder import folder_of_c
    from firmware_py.shell.parameters import addresses_from, config_from, require_proof
    from hil.record.new_file import write_anew

    parameters = parameters_of(scenario, change)
    config = config_from(require_proof(parameters))
    if without_gait and config.p.gait.follow > 0:
        raise BadInputError("--without-gait leaves out what firmware.gait.follow = 1 needs; drop one of them")
    emitter = emit(precision, not without_gait)
    files = folder_of_c(emitter, config, addresses_from(parameters))
    out.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_anew(out / name, text)
    lines, count = len(files["vibro_firmware.c"].splitlines()), len(emitter.functions)
    payload = {"files": [str(out / name) for name in files], "lines": lines, "functions": count}
    shown = f"{out}: {', '.join(files)}\n{count} functions on {lines:,} lines"
    answer(payload, as_json, lambda: console.print(shown, markup=False))


def show_sizes(found: dict[str, int], parts: dict[str, dict[str, int]], files: str) -> None:
    """Print the bytes of the code, and of config and state by block, then the files."""
    table = table_of(("what", "bytes"))
    for name, size in found.items():
        table.add_row(name, f"{size:,}", style="bold")
        for part, part_size in parts.get(name, {}).items():
            table.add_row(f"  {part}", f"{part_size:,}")
    console.print(table)
    console.print(files, markup=False)


@firmware.command()
def budget(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Scenarios to measure; by default an ordinary one and one with a stall."),
    ] = None,
    target: Annotated[
        Literal["cortex-m7", "cortex-m4f"], typer.Option(help="The emulated processor.")
    ] = "cortex-m7",
    as_json: Json = False,
) -> None:
    """Measure the firmware on an emulated Cortex-M: flash, RAM, stack, instructions per tick."""
    from tools.budget import budget as measure

    with shown_progress() as progress:
        found = measure(names or [], progress, target)
    answer(found, as_json)


@firmware.command()
def node(
    scenario: Scenario = None,
    bus: NodeBus = "auto",
    build: Controller = "compiled",
    out: Annotated[Path | None, folder_option("A run folder for the trace; by default none.")] = None,
    change: Change = None,
    seed: Annotated[int, typer.Option(help="Seed of the faults' random numbers.", min=0)] = 1,
    until: Until = None,
) -> None:
    """Run the controller as one CAN node at 1 kHz; the default of `vibrohil firmware`.

    On a bus that the bench has not made, it requires the test of the drive's watchdog before a start, unless
    firmware.watchdog.proof_required is set.
    """
    from hil.nodes.main import NodeProcess, firmware_main

    firmware_main(scenario, change or [], NodeProcess(bus, out, seed, until), build)
