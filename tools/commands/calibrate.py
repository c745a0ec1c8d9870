"""`vibrohil calibrate`: parameters of a running firmware over XCP, from any bus."""

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, NodeBus, setting
from tools.commands.places import file_option
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED, answer, console, table_of


def calibrate(
    values: Annotated[list[str], typer.Argument(help="Parameters: KEY=VALUE, e.g. speed.gain_p_n_m_s=0.06.")],
    *,
    bus: NodeBus = "auto",
    save: Annotated[
        Path | None, file_option("Write these parameters to a file for --parameters.", (".toml",))
    ] = None,
    change: Annotated[list[str] | None, setting("The module's numbers: firmware.bus.own_node=VALUE")] = None,
    as_json: Json = False,
) -> None:
    """Change tuning parameters of a running firmware, all together or none.

    At rest every tuning parameter may change, in motion those marked in the parameters' reference; limits,
    ceilings and watchdogs never. A power cycle restores the parameter file. Exit status 1 if one is refused.
    """
    from tools.runs.measured import change_parameters, pairs_of

    wanted = pairs_of(values)
    refused = change_parameters(wanted, bus, change or [], save)
    status = EXIT_CHECK_FAILED if refused else EXIT_PASSED

    def show() -> None:
        if refused:
            console.print(table_of(("refused", "why"), ((one["key"], one["why"]) for one in refused)))
        else:
            console.print("\n".join(f"{key} = {value:g}" for key, value in wanted.items()), markup=False)

    answer({"parameters": wanted, "refused": refused, "save": save}, as_json, show, status)
