"""`vibrohil trade`: speed against accuracy, measured on this machine."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tools.commands.options import Json
from tools.commands.places import PICTURES, file_option
from tools.output import answer, console, plain, show_records, show_tables
from tools.progress import shown_progress

if TYPE_CHECKING:
    from tools.trade.costs import Cost


trade = typer.Typer(name="trade", invoke_without_command=True)

Quick = Annotated[bool, typer.Option("--quick", help="Fewer settings and repeats: about a minute.")]


@trade.callback()
def measure(
    context: typer.Context,
    quick: Quick = False,
    plot: Annotated[Path | None, file_option("Draw error against cost into this file.", PICTURES)] = None,
    as_json: Json = False,
) -> None:
    """Measure error and cost of solvers, peers, stop models, control rates, builds and ticks."""
    if context.invoked_subcommand is not None:
        return
    from tools.trade import bench_tick, control_rate, costs, pictures
    from tools.trade import parts as stops
    from tools.trade.cases import CASES
    from tools.trade.peers import heyoka_peer

    repeats = costs.QUICK_REPEATS if quick else costs.REPEATS
    load_before = os.getloadavg()[0]
    measured: list[Cost] = []
    rows: list[dict[str, Any]] = []
    others: list[Callable[[costs.Progress], list[dict[str, Any]]]] = [
        lambda doing: stops.measure("fidelity", quick, repeats, doing),
        lambda doing: control_rate.measure(quick, doing),
        lambda doing: bench_tick.measure(repeats, doing),
    ]
    with shown_progress() as progress:
        steps = len(CASES) + len(others)
        for done, case in enumerate(CASES):
            doing = partial(progress, done / steps)
            measured += costs.measure(case, costs.methods_of(case, quick), repeats, doing)
        for done, measure_rows in enumerate(others, len(CASES)):
            rows += measure_rows(partial(progress, done / steps))
    notes = [] if heyoka_peer.is_installed() else [heyoka_peer.MISSING]
    payload: dict[str, Any] = {
        "rows": [*(cost.row() for cost in measured), *rows],
        "pareto": [cost.row()["what"] for cost in costs.pareto(measured)],
        "repeats": repeats,
        "load_average": {"before": load_before, "after": os.getloadavg()[0]},
        "cores": os.cpu_count(),
        "notes": notes,
    }
    if plot is not None:
        pictures.draw(measured, plot)
        payload["plot"] = str(plot)
    answer(payload, as_json, lambda: show(payload))


@trade.command()
def extremes(
    page: Annotated[Path, file_option("The page to write.", (".md",))] = Path("extremes.md"),
    as_json: Json = False,
) -> None:
    """Solve extreme cases by every method and write a page of the errors; takes minutes."""
    from tools.trade import extremes as core

    with shown_progress() as progress:
        rows = core.write(page, partial(progress, None))
    summary = f"{len(rows)} extremes by {len(core.METHODS)} methods: {page}"
    answer({"rows": rows, "page": str(page)}, as_json, lambda: console.print(summary))


@trade.command()
def parts(quick: Quick = False, as_json: Json = False) -> None:
    """Measure the cost and effect of each part of a scene."""
    from tools.trade import costs
    from tools.trade import parts as core

    repeats = costs.QUICK_REPEATS if quick else costs.REPEATS
    with shown_progress() as progress:
        rows = core.measure("part", quick, repeats, partial(progress, None))
    payload = {"rows": rows, "repeats": repeats, "cores": os.cpu_count()}
    answer(payload, as_json, lambda: show(payload))


LEGEND = (
    "error of solvers: of the state at the end, velocity over ω; of impacts the largest. Where there is a "
    "closed form it is the truth, else the adaptive solver at 1e-13. pareto: nothing cheaper errs less. "
    "error of parts: of the first row's impulse; energy: the drive's work a cycle; fold_r: the largest r at "
    "which impacts go on as the crank is made faster in steps of 0.01. Processor time of a thread, least of "
    "interleaved repeats: ratios hold better than figures."
)


def show(payload: Mapping[str, Any]) -> None:
    """Print a table for each kind of rows, then the other results."""
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in payload["rows"]:
        kinds.setdefault(row["kind"], []).append(row)
    for kind, rows in kinds.items():
        show_records(kind, plain(rows, finite=False))
    show_tables({name: value for name, value in payload.items() if name != "rows"})
    console.print(LEGEND, style="dim")
