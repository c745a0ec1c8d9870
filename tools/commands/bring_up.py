"""`vibrohil bring-up`: from an unknown module on a bus to a controller that is proven on its twin."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from tools.commands.options import Change, Json, NodeBus, number
from tools.commands.places import folder_option
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED, answer, progress_console

StepName = Literal["listen", "at-rest", "drive", "below-impacts", "first-impacts", "twin"]


def bring_up(
    *,
    bus: NodeBus = "auto",
    out: Annotated[Path, folder_option("The folder of the bring-up; one that was begun is continued.")],
    until: Annotated[StepName | None, typer.Option(help="The last step; by default all.")] = None,
    first: Annotated[
        StepName | None,
        typer.Option("--from", help="Repeat from this step; by default the first that has not passed."),
    ] = None,
    ratio: Annotated[
        float | None,
        number("The wanted speed over the natural frequency; by default that of before, or 1.25.", 0.9, 1.4),
    ] = None,
    change: Change = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Agree to every motion and change without a question.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Lead through the first day with hardware, one step after the other, each with its bounds.

    Before anything moves the command says what will move and asks; Ctrl-C is an E-stop at any time. The first
    impacts may use a quarter of limit.force_n, and those of a hard stop a half, then the whole, each after
    another yes. --set firmware.KEY=VALUE gives values of the data sheet, such as striker.mass_kg and
    striker.rest_length_m.
    """
    from firmware_py.shell.parameters import addresses_from, with_overrides
    from hil.scenario.settings import apply_settings
    from tools.bring_up.real import RealBench
    from tools.bring_up.session import Session, User, read_state

    tables = apply_settings({"firmware": {}}, change or [])["firmware"]
    settings = {f"{block}.{name}": value for block, table in tables.items() for name, value in table.items()}
    settings = {**read_state(out).settings, **settings}
    bench = RealBench(bus, addresses_from(with_overrides(settings)))

    def agrees(question: str) -> bool:
        try:
            return yes or typer.prompt(f"{question} Type yes", default="no", err=True) == "yes"
        except typer.Abort:  # the end of the input
            return False

    user = User(lambda sentence: progress_console.print(sentence, markup=False), agrees)
    result = Session(bench, out, settings, ratio, user).run(first, until)

    def show() -> None:
        from tools.output import show_tables

        show_tables({key: value for key, value in result.items() if key not in ("steps",)})

    answer(result, as_json, show, EXIT_PASSED if result["passed"] else EXIT_CHECK_FAILED)
