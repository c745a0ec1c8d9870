"""`vibrohil trade`: speed against accuracy, measured on this machine."""

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tools.commands.options import Json
from tools.output import answer, console, figure, table_of
from tools.outputs import PICTURES, file_option
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
    from tools.trade import bench_tick, builds, control_rate, costs, pictures
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
        lambda doing: builds.measure(repeats, doing),
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
    answer(payload, as_json, lambda: show_parts(rows, repeats))


Columns = Mapping[str, str]
"""The key of a row's figure by the title of its column."""


def table(title: str, rows: Iterable[Mapping[str, Any]], columns: Columns) -> Table:
    """A table of measured rows; a list of names counts as their number."""
    cells = ([cell(key, row[key]) for key in columns.values()] for row in rows)
    return table_of(columns, cells, title=title)


def cell(key: str, value: Any) -> str:
    """A row's value as text."""
    if key == "what":
        return str(value).partition(": ")[2]
    return figure(len(value) if isinstance(value, list) else value)


SOLVERS: Columns = {
    "method": "method",
    ">x [m]": "error",
    ">t [s]": "impact_time_error_s",
    ">v [m/s]": "impact_speed_error_m_s",
    ">impulse": "impulse_error",
    ">impacts": "impacts",
    ">µs/s": "cost",
    ">×": "cost_ratio",
}
PARTS: Columns = {
    "part": "what",
    ">µs/s": "cost",
    ">×": "cost_ratio",
    ">N s": "impulse_n_s",
    ">off by": "error",
    ">v⁻ m/s": "approach_m_s",
    ">peak N": "peak_force_n",
    ">felt N": "peak_felt_force_n",
    ">J": "energy_per_cycle_j",
    ">at terminals J": "terminal_energy_per_cycle_j",
    ">fold": "fold_r",
}
RATES: Columns = {
    "rate [Hz]": "rate_hz",
    ">x [m]": "error",
    ">v [m/s]": "v_rmse_m_s",
    ">late [ms]": "latency_p95_ms",
    ">ripple": "ripple",
    ">v⁻ [m/s]": "approach_m_s",
    ">regime": "regime",
    ">failed": "failed_checks",
    ">µs/s": "cost",
}
BUILDS: Columns = {
    "build": "build",
    "is": "setting",
    ">x [m]": "error",
    ">v [m/s]": "v_rmse_m_s",
    ">µs/tick": "cost",
}
TICKS: Columns = {"what": "what", ">µs/tick": "cost"}
TABLES: dict[str, tuple[str, Columns]] = {
    "fidelity": ("fidelity: table1 on its impact orbit at r = 1.3, ideal drive", PARTS),
    "control rate": (
        "control rate: soft start to r = 1.3 with motor, sensors and firmware, in lockstep",
        RATES,
    ),
    "firmware build": ("firmware builds: the same start in lockstep", BUILDS),
    "tick": ("a tick of 1 ms in compiled code, at r = 1.3 with impacts", TICKS),
}
"""Titles and columns of the tables by kind of row."""


PARTS_LEGEND = (
    "N s: an impact's impulse, — where impacts have ended; off by: its difference from the first row's; J: "
    "the drive's work a cycle, where windings are modelled also that at their terminals; fold: the largest r "
    "at which impacts go on as the crank is made faster in steps of 0.01. All by the adaptive solver."
)


def show_parts(rows: Sequence[Mapping[str, Any]], repeats: int) -> None:
    """Print the costs and effects of a scene's parts."""
    from tools.trade.parts import RATIO

    title = f"parts: table1 on its impact orbit at r = {RATIO}, one part changed at a time"
    console.print(table(title, rows, PARTS))
    console.print(
        f"×: cost over the first part's; {PARTS_LEGEND} "
        f"Processor time of a thread, least of {repeats} interleaved repeats."
    )


def show(payload: Mapping[str, Any]) -> None:
    """Print the costs as tables."""
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in payload["rows"]:
        kinds.setdefault(row["kind"], []).append(row)
    for case in dict.fromkeys(row["case"] for row in kinds["solver"]):
        show_case([row for row in kinds["solver"] if row["case"] == case], payload["pareto"])
    for kind, (title, columns) in TABLES.items():
        console.print(table(title, kinds[kind], columns))
        if columns is PARTS:
            console.print(PARTS_LEGEND)
    load = payload["load_average"]
    console.print(
        "x: state at the end, velocity over ω; t, v: largest of an impact; impulse: share of all exchanged; "
        "×: cost over the cheapest; ●: nothing cheaper errs less; ≠: wrong number of impacts. Where there is "
        "a closed form it is the truth, else the adaptive solver at 1e-13. Processor time of a thread, least "
        f"of {payload['repeats']} interleaved repeats, a row of calls each, as called from Python. "
        f"{payload['cores']} cores, load "
        f"{load['before']:.1f} before and {load['after']:.1f} after: ratios hold better than figures."
    )
    for note in payload["notes"]:
        console.print(f"note: {note}")


def show_case(rows: Sequence[Mapping[str, Any]], best: Collection[str]) -> None:
    """Print the errors and costs of every method on one case; ● marks what no cheaper one beats in error."""
    first, cheapest = rows[0], min(row["cost"] for row in rows)
    shown = [
        {
            **row,
            "method": f"{row['method']} {row['setting']}".rstrip() + (" ●" if row["what"] in best else ""),
            "impacts": ("" if row["impacts"] == row["impacts_wanted"] else "[red]≠[/] ")
            + str(row["impacts"]),
            "cost_ratio": row["cost"] / cheapest,
        }
        for row in rows
    ]
    console.print(table(f"{first['case']}: {first['impacts_wanted']} impacts", shown, SOLVERS))
