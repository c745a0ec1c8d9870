"""`vibrohil trade`: speed against accuracy, measured on this machine."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
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


def trade(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer settings and repeats: about a minute.")
    ] = False,
    parts: Annotated[
        bool, typer.Option("--parts", help="Measure the cost and effect of each part of a scene instead.")
    ] = False,
    extremes: Annotated[
        Path | None,
        file_option("Write the page of extreme cases by every method instead; takes minutes.", (".md",)),
    ] = None,
    plot: Annotated[Path | None, file_option("Draw error against cost into this file.", PICTURES)] = None,
    as_json: Json = False,
) -> None:
    """Measure error and cost of solvers, peers, stop models, control rates, builds and ticks."""
    from tools.trade import bench_tick, builds, control_rate, costs, fidelity, heyoka_peer, pictures
    from tools.trade.cases import CASES

    repeats = costs.QUICK_REPEATS if quick else costs.REPEATS
    if parts:
        measure_parts(quick, repeats, as_json)
        return
    if extremes is not None:
        write_extremes(extremes, as_json)
        return
    load_before = os.getloadavg()[0]
    measured: list[Cost] = []
    with shown_progress() as progress:
        steps = len(CASES) + 4
        for done, case in enumerate(CASES):
            share = done / steps
            measured += costs.measure(case, costs.methods_of(case, quick), repeats, partial(progress, share))
        of_parts = fidelity.measure(quick, repeats, partial(progress, len(CASES) / steps))
        of_rates = control_rate.measure(quick, partial(progress, (len(CASES) + 1) / steps))
        of_builds = builds.measure(repeats, partial(progress, (len(CASES) + 2) / steps))
        of_ticks = bench_tick.measure(repeats, partial(progress, (len(CASES) + 3) / steps))
    notes = [] if heyoka_peer.is_installed() else [heyoka_peer.MISSING]
    payload: dict[str, Any] = {
        "rows": [*(cost.row() for cost in measured), *of_parts, *of_rates, *of_builds, *of_ticks],
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


def write_extremes(page: Path, as_json: bool) -> None:
    """Write the page of the extreme cases and its plot, and print a summary."""
    from tools.trade import extremes

    with shown_progress() as progress:
        rows = extremes.write(page, partial(progress, None))
    summary = f"{len(rows)} extremes by {len(extremes.METHODS)} methods: {page}"
    answer({"rows": rows, "page": str(page)}, as_json, lambda: console.print(summary))


def measure_parts(quick: bool, repeats: int, as_json: bool) -> None:
    """Measure the costs of a scene's parts and print them."""
    from tools.trade import parts

    with shown_progress() as progress:
        rows = parts.measure(quick, repeats, partial(progress, None))
    payload = {"rows": rows, "repeats": repeats, "cores": os.cpu_count()}
    answer(payload, as_json, lambda: show_parts(rows, repeats))


def show_parts(rows: Sequence[Mapping[str, Any]], repeats: int) -> None:
    """Print the costs and effects of a scene's parts."""
    from tools.trade.parts import RATIO

    shown = (
        (
            row["what"].removeprefix("part: "),
            f"{row['cost']:.0f}",
            f"{row['cost_ratio']:.2f}",
            figure_of(row["impulse_n_s"], 3),
            figure_of(row["peak_force_n"], 0),
            figure_of(row["peak_felt_force_n"], 0),
            f"{row['energy_per_cycle_j']:.3f}",
            figure_of(row["terminal_energy_per_cycle_j"], 3),
            f"{row['fold_r']:.2f}",
        )
        for row in rows
    )
    title = f"parts: table1 on its impact orbit at r = {RATIO}, one part changed at a time"
    names = ("part", ">µs/s", ">×", ">N s", ">peak N", ">felt N", ">J", ">at terminals J", ">fold")
    console.print(table_of(names, shown, title=title))
    console.print(
        "×: cost over the first part's; N s: an impact's impulse, — where impacts have ended; J: the drive's "
        "work a cycle, where windings are modelled also that at their terminals; fold: the largest r at "
        "which impacts go on as the crank is made faster in steps of 0.01. All by the adaptive solver. "
        f"Processor time of a thread, least of {repeats} interleaved repeats."
    )


def figure_of(value: float, digits: int) -> str:
    """A figure with this number of digits after the point, or a dash."""
    return "—" if math.isnan(value) else f"{value:.{digits}f}"


def show(payload: Mapping[str, Any]) -> None:
    """Print the costs as tables."""
    rows = payload["rows"]
    for case in dict.fromkeys(row["case"] for row in rows if row["kind"] == "solver"):
        console.print(solver_table(case, [row for row in rows if row.get("case") == case], payload["pareto"]))
    console.print(parts_table([row for row in rows if row["kind"] == "fidelity"]))
    console.print(rates_table([row for row in rows if row["kind"] == "control rate"]))
    console.print(builds_table([row for row in rows if row["kind"] == "firmware build"]))
    console.print(ticks_table([row for row in rows if row["kind"] == "tick"]))
    load = payload["load_average"]
    console.print(
        "x: state at the end, velocity over ω; t, v: largest of an impact; impulse: share of all exchanged; "
        "×: cost over the cheapest; ●: nothing cheaper errs less; ≠: wrong number of impacts. Where there is "
        "a closed form it is the truth, else the adaptive solver at 1e-13. Processor time of a thread, least "
        f"of {payload['repeats']} interleaved repeats, a row of calls each, as called from Python; a first "
        f"call takes longer (cost_first with --json). {payload['cores']} cores, load "
        f"{load['before']:.1f} before and {load['after']:.1f} after: ratios hold better than figures."
    )
    for note in payload["notes"]:
        console.print(f"note: {note}")


def solver_table(case: str, rows: Sequence[Mapping[str, Any]], best: Iterable[str]) -> Table:
    """Errors and cost of every method on one case; ● marks a method that no cheaper one beats in error."""
    cheapest = min(row["cost"] for row in rows)
    errors = ("error", "impact_time_error_s", "impact_speed_error_m_s", "impulse_error")

    def shown(row: Mapping[str, Any]) -> Iterator[str]:
        is_right = (row["impacts"], row["regime"]) == (row["impacts_wanted"], row["regime_wanted"])
        yield f"{row['method']} {row['setting']}".rstrip() + (" ●" if row["what"] in best else "")
        yield from ("—" if math.isnan(row[key]) else f"{row[key]:.0e}" for key in errors)
        yield str(row["impacts"]) if is_right else f"[red]≠ {row['impacts']}[/]"
        yield f"{row['cost']:.1f}"
        yield f"{row['cost'] / cheapest:.1f}"

    titles = ("method", ">x [m]", ">t [s]", ">v [m/s]", ">impulse", ">impacts", ">µs/s", ">×")
    title = f"{case}: {rows[0]['impacts_wanted']} impacts, {rows[0]['regime_wanted']}"
    return table_of(titles, map(shown, rows), title=title)


def parts_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Effect and cost of each stop model."""
    shown = (
        (
            row["what"].removeprefix("fidelity: "),
            f"{row['impulse_n_s']:.4f}",
            f"{100.0 * row['error']:.1f} %",
            figure(row["peak_force_n"]),
            f"{row['approach_m_s']:.4f}",
            row["method"],
            f"{row['cost']:.1f}",
        )
        for row in rows
    )
    titles = ("stop", ">impulse [N s]", ">off by", ">peak [N]", ">v⁻ [m/s]", ">method", ">µs/s")
    return table_of(titles, shown, title="fidelity: table1 on its impact orbit at r = 1.3, ideal drive")


def rates_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Accuracy and cost of each control rate."""
    shown = (
        (
            str(row["rate_hz"]),
            f"{1e3 * row['error']:.2f}",
            f"{row['v_rmse_m_s']:.4f}",
            f"{row['latency_p95_ms']:.2f}",
            f"{row['ripple']:.5f}",
            f"{row['approach_m_s']:.4f}",
            row["regime"],
            str(len(row["failed_checks"])),
            f"{1e-3 * row['cost']:.0f}",
        )
        for row in rows
    )
    numbers = (">x [mm]", ">v [m/s]", ">late [ms]", ">ripple", ">v⁻ [m/s]", ">regime", ">failed", ">ms/s")
    title = "control rate: soft start to r = 1.3 with motor, sensors and firmware, in lockstep"
    return table_of(("rate [Hz]", *numbers), shown, title=title)


def builds_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Accuracy and cost of each build of the firmware."""
    shown = (
        (
            f"{row['build']}: {row['setting']}",
            f"{1e3 * row['error']:.3f}",
            f"{row['v_rmse_m_s']:.5f}",
            str(row["decisions"]),
            str(row["decisions_that_differ"]),
            f"{row['cost']:.1f}",
        )
        for row in rows
    )
    title = (
        "firmware builds: the same start in lockstep; differ: decisions over a tick off the compiled build's"
    )
    return table_of(("build", ">x [mm]", ">v [m/s]", ">decisions", ">differ", ">µs/tick"), shown, title=title)


def ticks_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Cost of a tick of the bench in compiled code."""
    shown = ((row["what"].removeprefix("tick: "), f"{row['cost']:.2f}") for row in rows)
    title = "a tick of 1 ms in compiled code, at r = 1.3 with impacts"
    return table_of(("what", ">µs/tick"), shown, title=title)
