"""`vibrohil run SCENARIO`: one run of firmware and plant on a bus, with a verdict."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import FirmwareBuild, Json, ParameterFiles, note_unused_bus, setting
from tools.output import BadInputError, answer, console, exit_of, figure, figure_table, table_of
from tools.outputs import folder_option
from tools.progress import shown_progress

if TYPE_CHECKING:
    from hil.scenario.scenario import Scenario


def run(
    scenario: Annotated[str, typer.Argument(help="A scenario's name or its TOML file.")],
    clock: Annotated[
        Literal["real", "patient", "lockstep"],
        typer.Option(
            help="real: two processes in real time; patient: they wait for each other; lockstep: one process."
        ),
    ] = "real",
    bus: Annotated[
        str, typer.Option(help="auto, vcan, local, socketcan:can0 or any python-can interface:channel.")
    ] = "auto",
    firmware: FirmwareBuild = "python",
    out: Annotated[Path | None, folder_option("The run folder; by default a new one under runs/.")] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of all random numbers; by default the scenario's, or 1.", min=0)
    ] = None,
    change: Annotated[
        list[str] | None, setting("Change a value: scene.KEY, firmware.KEY or script.KEY=VALUE")
    ] = None,
    parameters: ParameterFiles = None,
    soak: Annotated[
        str | None,
        typer.Option(help="Extend the run by this time before its last command, e.g. 10m, and check memory."),
    ] = None,
    keep_traces: Annotated[
        bool, typer.Option("--keep-traces", help="Keep the traces of a passed run too.")
    ] = False,
    live: Annotated[
        bool, typer.Option(help="Show the run while it runs, in an open viewer or a new window.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run one scenario, record every signal, and judge it."""
    from hil.bench.bench import run_scenario
    from hil.scenario.scenario import load_scenario

    loaded = load_scenario(scenario, change or [], parameters or [])
    if soak is not None:
        loaded = longer(loaded, soak, clock)
    note_unused_bus(bus, clock)
    viewer = None
    if live:
        from tools.logs.view import live_viewer

        viewer = live_viewer()
    with shown_progress() as progress:
        verdict = run_scenario(
            loaded,
            clock=clock,
            bus=bus,
            out_dir=out,
            seed=loaded.seed if seed is None else seed,
            progress=progress,
            viewer=viewer,
            firmware=firmware,
            keep_traces=keep_traces,
        )
    answer(verdict, as_json, lambda: show(verdict), exit_of(verdict))


def longer(scenario: "Scenario", by: str, clock: str) -> "Scenario":
    """The scenario with more time before its last command."""
    from hil.bench.soak import duration_s, prolonged
    from hil.scenario.scenario import check_scenario

    try:
        document = prolonged(scenario.document, duration_s(by), clock)
    except ValueError as error:
        raise BadInputError(f"--soak: {error}") from error
    return check_scenario(document, scenario.name, [*scenario.changes, f"soak={by}"])


def show(verdict: dict[str, Any]) -> None:
    """Print a run's figures, its checks and its verdict."""
    estimate, detector, tick = verdict["estimate"], verdict["detector"], verdict["tick_us"]
    speeds = [impact["v_m_s"] for impact in verdict["impacts"]]
    rows = [
        ("clock", verdict["clock"], ""),
        ("bus", f"{verdict['bus']}{' (SocketCAN)' if verdict['kernel_can'] else ''}", ""),
        ("duration", verdict["duration_s"], "s"),
        ("regime", verdict["regime"], ""),
        ("impacts", len(speeds), ""),
        ("last approach speed", speeds[-1] if speeds else None, "m/s"),
        ("peak stop force", verdict["peak_force_n"], "N"),
        ("peak felt force", verdict["felt"]["peak_n"], "N"),
        ("position RMSE", None if estimate["x_rmse_m"] is None else 1e3 * estimate["x_rmse_m"], "mm"),
        ("velocity RMSE", estimate["v_rmse_m_s"], "m/s"),
        ("detector precision", detector["precision"], ""),
        ("detector recall", detector["recall"], ""),
        ("detection latency p50", detector["latency_ms"]["p50"], "ms"),
        ("firmware work p50 / p99", f"{figure(tick['p50'])} / {figure(tick['p99'])}", "µs"),
        ("overruns / bare loop's", f"{verdict['overruns']} / {figure(verdict['baseline_overruns'])}", ""),
        ("met its timing", verdict["real_time"], ""),
        ("times real time", verdict["realtime_factor"], ""),
        ("bus load", None if verdict["bus_load"] is None else 100 * verdict["bus_load"], "%"),
    ]
    console.print(figure_table(verdict["scenario"], rows))
    show_checks(verdict)


def show_checks(verdict: dict[str, Any]) -> None:
    """Print a run's checks and its verdict."""
    figures = (Column(title, no_wrap=True) for title in ("value", "limit", ""))
    checks = table_of((Column("check", overflow="fold"), *figures))
    for check in verdict["checks"]:
        mark = "[green]passed[/]" if check["passed"] else "[bold red]failed[/]"
        plain = (check["name"], figure(check["value"], check["unit"]), str(check["limit"]))
        checks.add_row(*map(escape, plain), mark)
    console.print(checks)
    latched = verdict.get("latched", {})
    if not verdict["passed"] and latched.get("at_s") is not None:
        console.print(
            f"fault {verdict['fault']} at {figure(latched['at_s'])} s; the longest that loops were held up "
            f"just before it: firmware {figure(latched['firmware_held_ms'])} ms, "
            f"plant {figure(latched['plant_held_ms'])} ms"
        )
    for loss in verdict.get("losses", []):
        console.print(
            f"[yellow]can.log lacks {loss['frames']} frames between {loss['from_s']:.3f} s and "
            f"{loss['to_s']:.3f} s; incomplete: {', '.join(verdict['incomplete'])}[/]"
        )
    for reason in filter(None, [*verdict.get("reasons", []), verdict.get("host_stall")]):
        console.print(f"[bold red]{escape(reason)}[/]")
    words = {
        True: "[bold green]PASSED[/]",
        False: "[bold red]FAILED[/]",
        None: "NOT JUDGED: nothing was checked",
    }
    word = words[verdict["passed"]]
    console.print(f"{word}  {escape(verdict['out'])}", soft_wrap=True)
