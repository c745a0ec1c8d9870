"""`vibrohil measure`: the firmware's signals over XCP, from any bus."""

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, NodeBus, number, setting
from tools.commands.places import folder_option
from tools.output import answer, console


def measure(
    signals: Annotated[
        list[str] | None, typer.Argument(help="Signals by the log's names, e.g. state.estimator.x_m.")
    ] = None,
    *,
    bus: NodeBus = "auto",
    rate: Annotated[float, number("Samples of each signal per second.", 4.0, 1000.0)] = 25.0,
    until: Annotated[float, number("Measure for this time in s; Ctrl-C ends earlier.", 0.0)] = 10.0,
    live: Annotated[bool, typer.Option("--live", help="Show the signals in a waiting viewer.")] = False,
    out: Annotated[
        Path | None, folder_option("A folder for the log `measured.rrd`; by default none.")
    ] = None,
    change: Annotated[list[str] | None, setting("The module's numbers: firmware.bus.own_node=VALUE")] = None,
    names: Annotated[bool, typer.Option("--list", help="Print the names of all signals.")] = False,
    as_json: Json = False,
) -> None:
    """Measure signals of a running firmware, simulated or on a board, on any bus.

    The bus carries one frame of samples per tick: one signal at 1 kHz or forty at 25 Hz, as float32.
    """
    from firmware_py.node.elements import ALL
    from tools.runs.measured import measure_signals
    from tools.xcp_master import Sampled

    if names:
        every = [place.name for place in ALL]
        answer({"signals": every}, as_json, lambda: console.print("\n".join(every), markup=False))
        return
    if not signals:
        raise typer.BadParameter("name at least one signal; --list prints their names")
    wanted = Sampled(signals, max(round(1000.0 / rate), 1))
    found = measure_signals(wanted, bus, change or [], until, live, out)
    answer({"signals": found, "out": out}, as_json)
