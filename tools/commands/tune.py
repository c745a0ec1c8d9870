"""`vibrohil tune`: the firmware's parameters designed, fitted to a log, or chosen on draws; and compared."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from tools.output import (
    EXIT_CHECK_FAILED,
    BadInputError,
    console,
    figure,
    figure_table,
    print_json,
    progress_console,
)

if TYPE_CHECKING:
    from tools.tuning.result import Tuning
    from tools.tuning.safety import Bench, SafetyResult

tune = typer.Typer(
    name="tune",
    help="Design and fit the firmware's parameters; each command writes a parameter file that the safety "
    "scenarios have let pass.",
    no_args_is_help=True,
)

Force = Annotated[
    bool, typer.Option("--force", help="Write the file although a safety scenario fails; it then says so.")
]
Plot = Annotated[Path | None, typer.Option(help="Draw what explains the result into this SVG or PNG.")]
Seed = Annotated[int | None, typer.Option(help="Of the draws to choose on, below 10000.", min=0)]
FreshSeed = Annotated[int | None, typer.Option(help="Of the draws to judge on, from 10000 on.", min=0)]
Workers = Annotated[int | None, typer.Option(help="Processes; by default one a core.", min=1)]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.add_typer(tune)


def progress_bar() -> Progress:
    """On standard error, gone at the end."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(),
        console=progress_console,
        transient=True,
    )


def refuse_other_pictures(plot: Path | None) -> None:
    """Before anything is computed."""
    if plot is not None and plot.suffix not in (".svg", ".png"):
        raise BadInputError(f"--plot is {plot}: wanted a file ending in .svg or .png, e.g. tune.svg")


def finish(
    tuning: "Tuning",
    out: Path,
    force: bool,
    bar: Progress,
    more: Mapping[str, Any],
    bench: "Bench | None" = None,
) -> tuple[dict[str, Any], list["SafetyResult"]]:
    """Judge, write, and give the JSON object."""
    from tools.tuning.parameter_file import write
    from tools.tuning.safety import judge_safety

    task = bar.add_task("safety scenarios", total=1.0)

    def progress(fraction: float, doing: str) -> None:
        bar.update(task, completed=fraction, description=f"safety: {doing}")

    safety = judge_safety(tuning.values, progress, bench)
    safe = all(result.passed for result in safety)
    if safe or force:
        write(out, tuning, safety, force)
    return {
        **tuning.as_json(),
        **more,
        "safety": [result.as_json() for result in safety],
        "safe": safe,
        "out": str(out) if safe or force else None,
    }, safety


def report(payload: Mapping[str, Any], as_json: bool) -> None:
    """Print it; a file that was not written is a failed check."""
    if as_json:
        print_json(payload)
    else:
        show(payload)
    if payload["out"] is None:
        raise typer.Exit(EXIT_CHECK_FAILED)


def show(payload: Mapping[str, Any]) -> None:
    """Parameters, figures of merit, warnings and what the safety scenarios said."""
    from firmware_py.shell.parameters import DEFAULTS

    console.print(f"[bold]tune {payload['command']}[/]: {payload['source']}", highlight=False)
    table = Table(box=None, pad_edge=False)
    for name in ("parameter", "value", "low", "high", "default", "unit"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right", no_wrap=True)
    for name, value in payload["parameters"].items():
        numbers = (value["value"], value["low"], value["high"], DEFAULTS[name])
        table.add_row(name, *(f"{number:.5g}" for number in numbers), value["unit"])
    console.print(table)
    console.print(f"low, high: {payload['range_is']}", highlight=False, style="dim")
    rows = [
        (name.replace("_", " "), m["value"], m["unit"]) for name, m in payload["figures_of_merit"].items()
    ]
    console.print(figure_table("figures of merit", rows))
    for warning in payload["warnings"]:
        console.print(f"[bold yellow]warning:[/] {warning}", highlight=False)
    show_safety(payload["safety"])
    if payload["out"] is None:
        console.print("[bold red]not written[/]; --force writes it all the same", highlight=False)
    else:
        forced = "" if payload["safe"] else "  [bold red]by force[/]"
        console.print(f"[bold green]written[/]{forced}  {payload['out']}", highlight=False, soft_wrap=True)


def show_safety(safety: Sequence[Mapping[str, Any]]) -> None:
    """One line a judgement."""
    for result in safety:
        mark = "[green]passed[/]" if result["passed"] else f"[bold red]failed[/]: {result['why']}"
        console.print(f"safety, {result['scenario']}: {mark}", highlight=False)


@tune.command()
def speed(
    bandwidth_hz: Annotated[
        float | None, typer.Option(help="From target to speed, −3 dB; by default the firmware's.", min=0.1)
    ] = None,
    phase_margin_deg: Annotated[
        float | None, typer.Option(help="What is left of it decides the integral.", min=1.0, max=120.0)
    ] = None,
    inertia_kg_m2: Annotated[float | None, typer.Option(help="Of rotor and flywheel.", min=1e-7)] = None,
    tracker_rad_s: Annotated[float | None, typer.Option(help="The encoder tracker's poles.", min=1.0)] = None,
    measure: Annotated[
        bool, typer.Option(help="Measure the loop in lockstep, with sines on the torque's frames.")
    ] = True,
    out: Annotated[Path, typer.Option(help="The parameter file.")] = Path("speed.toml"),
    plot: Plot = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """PI gains of the crank's speed loop for a bandwidth and a phase margin, measured on the bench."""
    from hil.parameter_file import nested
    from tools.tuning.speed import BANDWIDTH_HZ, PHASE_MARGIN_DEG, Belief, tune_speed
    from tools.tuning.speed_figure import draw_speed
    from tools.tuning.speed_measurement import compared, measure_loop

    refuse_other_pictures(plot)
    given = {"inertia_kg_m2": inertia_kg_m2, "tracker_rad_s": tracker_rad_s}
    belief = Belief(**{name: value for name, value in given.items() if value is not None})
    tuning, design = tune_speed(belief, bandwidth_hz or BANDWIDTH_HZ, phase_margin_deg or PHASE_MARGIN_DEG)
    more: dict[str, Any] = {}
    with progress_bar() as bar:
        measured = None
        if measure:
            task = bar.add_task("measuring the loop", total=1.0)
            measured = measure_loop(
                nested(tuning.values), progress=lambda share, _: bar.update(task, completed=share)
            )
            tuning, more["measured"] = compared(tuning, belief, measured)
        if plot is not None:
            draw_speed(belief, design, measured, plot)
            more["plot"] = str(plot)
        payload, _ = finish(tuning, out, force, bar, more)
    report(payload, as_json)


@tune.command()
def identify(
    source: Annotated[Path, typer.Argument(help="A run folder, or a candump log of a real bench.")],
    scene: Annotated[
        str | None,
        typer.Option(help="The plant of the safety scenarios; by default the run's own, else theirs."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the resampling that gives the bounds.", min=0)] = 1,
    out: Annotated[Path, typer.Option(help="The parameter file.")] = Path("identified.toml"),
    plot: Plot = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Spring, friction, crank radius and stop from one log; only what went over CAN is used."""
    from tools.tuning.identify import bench_of, tune_identify
    from tools.tuning.identify_figure import draw_identified

    refuse_other_pictures(plot)
    bench = bench_of(source, scene)
    with progress_bar() as bar:
        bar.add_task("fitting", total=None)
        tuning, identified, readings = tune_identify(source, seed)
        more: dict[str, Any] = {"law": identified.law.value}
        if plot is not None:
            draw_identified(identified, readings, plot)
            more["plot"] = str(plot)
        payload, _ = finish(tuning, out, force, bar, more, bench)
    report(payload, as_json)


@tune.command()
def detector(
    cost_miss: Annotated[float, typer.Option(help="What a blow that is not seen costs.")] = 1.0,
    cost_false_alarm: Annotated[float, typer.Option(help="What a blow that was none costs.")] = 1.0,
    trials: Annotated[int | None, typer.Option(help="Draws for each floor.", min=11)] = None,
    seed: Seed = None,
    fresh_seed: FreshSeed = None,
    workers: Workers = None,
    out: Annotated[Path, typer.Option(help="The parameter file.")] = Path("detector.toml"),
    plot: Plot = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """The floor of the blow detector from what misses and false alarms cost, on drawn modules."""
    from tools.tuning.candidates import FRESH_SEED, TUNING_SEED
    from tools.tuning.detector import TRIALS, tune_detector
    from tools.tuning.detector_figure import draw_detector

    refuse_other_pictures(plot)
    with progress_bar() as bar:
        task = bar.add_task("compiling", total=None)
        tuning, points = tune_detector(
            cost_miss,
            cost_false_alarm,
            trials=trials or TRIALS,
            seed=TUNING_SEED if seed is None else seed,
            fresh_seed=FRESH_SEED if fresh_seed is None else fresh_seed,
            progress=lambda done, total: bar.update(task, completed=done, total=total, description="draws"),
            workers=workers,
        )
        more: dict[str, Any] = {
            "characteristic": [
                {**asdict(point), "false_alarms_1_h": point.false_alarms_1_h} for point in points
            ]
        }
        if plot is not None:
            draw_detector(tuning, points, plot)
            more["plot"] = str(plot)
        payload, _ = finish(tuning, out, force, bar, more)
    report(payload, as_json)


@tune.command()
def start(
    trials: Annotated[int | None, typer.Option(help="Draws for each ramp.", min=12)] = None,
    fresh_trials: Annotated[int | None, typer.Option(help="Draws to judge the winner on.", min=12)] = None,
    seed: Seed = None,
    fresh_seed: FreshSeed = None,
    workers: Workers = None,
    out: Annotated[Path, typer.Option(help="The parameter file.")] = Path("start.toml"),
    plot: Plot = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """The soft start's ramp that fails least, then overshoots little, then is quick, on drawn starts."""
    from tools.tuning.candidates import FRESH_SEED, TUNING_SEED
    from tools.tuning.start import FRESH_TRIALS, TRIALS, tune_start
    from tools.tuning.start_figure import draw_start

    refuse_other_pictures(plot)
    with progress_bar() as bar:
        task = bar.add_task("compiling", total=None)
        tuning, tried = tune_start(
            trials=trials or TRIALS,
            fresh_trials=fresh_trials or FRESH_TRIALS,
            seed=TUNING_SEED if seed is None else seed,
            fresh_seed=FRESH_SEED if fresh_seed is None else fresh_seed,
            progress=lambda done, total: bar.update(task, completed=done, total=total, description="draws"),
            workers=workers,
        )
        more: dict[str, Any] = {"tried": [asdict(one) for one in tried]}
        if plot is not None:
            draw_start(tuning, tried, plot)
            more["plot"] = str(plot)
        payload, _ = finish(tuning, out, force, bar, more)
    report(payload, as_json)


@tune.command()
def diff(
    a: Annotated[Path, typer.Argument(help="A parameter file.")],
    b: Annotated[Path, typer.Argument(help="Another one.")],
    as_json: Json = False,
) -> None:
    """What changed between two parameter files; one that lacks a parameter has its default."""
    from tools.tuning.difference import difference

    payload = difference(a, b)
    if as_json:
        print_json(payload)
        return
    table = Table(box=None, pad_edge=False)
    for name in ("parameter", a.name, b.name, "change", "unit"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right", no_wrap=True)
    for change in payload["changed"]:
        relative = "—" if change["relative"] is None else f"{100.0 * change['relative']:+.3g} %"
        sides = (
            f"{change[side]:.5g}" if change[f"named_in_{side}"] else f"default {change[side]:.5g}"
            for side in ("a", "b")
        )
        table.add_row(change["name"], *sides, relative, change["unit"])
    if payload["changed"]:
        console.print(table)
    else:
        console.print("no parameter differs")
    merits = Table(box=None, pad_edge=False)
    for name in ("figure of merit", a.name, b.name, "unit"):
        merits.add_column(name, justify="left" if name in ("figure of merit", "unit") else "right")
    for name, merit in payload["figures_of_merit"].items():
        merits.add_row(name.replace("_", " "), figure(merit["a"]), figure(merit["b"]), merit["unit"])
    console.print(merits)
    for side, path in (("a", a), ("b", b)):
        if payload["safe"][side] is False:
            console.print(f"[bold red]{path} was written by force[/]: a safety scenario fails with it")
