"""`vibrohil campaign NAME`: Monte Carlo of the closed loop over truth and starts, compiled."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import FirmwareBuild, Json, Workers, setting
from tools.output import BadInputError, answer, console, exit_of, figure, table_of
from tools.progress import counted_progress, shown_progress

if TYPE_CHECKING:
    from firmware_py.shell.builds import Build
    from tools.campaign.trial.outcome import Outcome
    from tools.campaign.trial.scenarios import Trial

BARS = " ▁▂▃▄▅▆▇█"
MOST_FAILURES = 20


def campaign(
    name: Annotated[
        Literal[
            "start-up",
            "estimate",
            "estimate-coarse",
            "detect",
            "shock",
            "hold",
            "recover",
            "walk",
            "endurance",
        ],
        typer.Argument(help="The campaign; endurance tests the covariance over many ticks."),
    ],
    trials: Annotated[
        int | None, typer.Option(help="Number of trials; by default enough for the campaign's goals.", min=1)
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Seed of all trials, by default 20260; seeds below 10000 belong to tuning and tests.", min=0
        ),
    ] = None,
    change: Annotated[
        list[str] | None, setting("Change a value: scene.KEY, firmware.KEY or campaign.KEY=VALUE")
    ] = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler to run on instead of this machine.")
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(help="Write trials as scenarios under runs/: failures, all, or a trial's number."),
    ] = None,
    ticks: Annotated[
        int | None, typer.Option(help="Ticks of an endurance run, by default a million.", min=10_000)
    ] = None,
    firmware: FirmwareBuild = "compiled",
    as_json: Json = False,
) -> None:
    """Run the closed loop on many sampled modules and starts, and judge the results by goals."""
    if name == "endurance":
        refuse_unused(name, trials=trials, seed=seed, workers=workers, scheduler=scheduler, keep=keep)
        result = run_endurance(ticks or 1_000_000, change or [], firmware)
    else:
        refuse_unused(name, ticks=ticks)
        seed = 20_260 if seed is None else seed
        result = run_campaign(name, trials, seed, change or [], workers, scheduler, keep, firmware)
    shown = show_endurance if name == "endurance" else show
    answer(result, as_json, lambda: shown(result), exit_of(result))


def refuse_unused(name: str, **options: Any) -> None:
    """Raise BadInputError for options that the campaign `name` would ignore."""
    given = " and ".join(f"--{option}" for option, value in options.items() if value is not None)
    if given:
        raise BadInputError(f"{given}: campaign {name} does not use this; leave it out")


def run_endurance(ticks: int, changes: list[str], firmware: "Build") -> dict[str, Any]:
    """Run the closed loop for many ticks in one run; BadInputError for an emulated board."""
    from firmware_py.shell.builds import NATIVE
    from tools.campaign.endurance import endurance

    if firmware not in NATIVE:
        raise BadInputError(f"--firmware {firmware}: an endurance run takes {' or '.join(NATIVE)}")
    with shown_progress() as progress:
        return endurance(ticks, changes, build=firmware, progress=progress)


def run_campaign(
    name: str,
    trials: int | None,
    seed: int,
    changes: list[str],
    workers: int | None,
    scheduler: str | None,
    keep: str | None,
    firmware: "Build",
) -> dict[str, Any]:
    """Run all trials with a progress bar, and write the requested ones as scenarios."""
    from hil.bench.bench import prepare
    from hil.record.run_folder import RUNS
    from plant_sim.scene import load_scene
    from tools.campaign.campaigns import CAMPAIGNS
    from tools.campaign.processes import run_all
    from tools.campaign.results import result_of
    from tools.campaign.trial.reference import refuse_other_drives
    from tools.campaign.trial.scenarios import trial_of

    chosen = CAMPAIGNS[name]
    count = trials or chosen.trials
    plan = chosen.plan(changes, seed, firmware)
    for cell in plan.cells:
        refuse_other_drives(load_scene(cell.scene))
    refuse_unknown_trials(keep, count)
    prepare(firmware, "lockstep")
    started_s = time.perf_counter()
    with counted_progress(name, count) as progress:
        outcomes = run_all(plan, count, lambda done, _: progress(done), workers, scheduler)
    result = result_of(chosen, plan.cells, outcomes, seed, time.perf_counter() - started_s)
    folder = RUNS / f"campaign-{name}-{seed}"
    result["kept"] = [str(keep_trial(folder, trial_of(plan, trial))) for trial in kept_of(outcomes, keep)]
    return result


def refuse_unknown_trials(keep: str | None, trials: int) -> None:
    """Raise BadInputError if `--keep` names no trial."""
    if keep not in (None, "failures", "all") and not (keep.isdecimal() and int(keep) < trials):
        raise BadInputError(f"--keep {keep}: wanted failures, all, or a trial's number, 0 … {trials - 1}")


def kept_of(outcomes: "Sequence[Outcome]", keep: str | None) -> list[int]:
    """The numbers of the trials to be written as scenarios."""
    if keep in ("failures", "all"):
        return [one.trial for one in outcomes if keep == "all" or (one.eligible and one.why)]
    return [] if keep is None else [int(keep)]


def keep_trial(folder: Path, trial: "Trial") -> Path:
    """Write a trial's scenario; `vibrohil run`, compiled and in lockstep, repeats it bit for bit."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{trial.scenario.name}.toml"
    path.write_text(tomli_w.dumps(trial.scenario.document), encoding="utf-8")
    return path


def histogram(counts: list[int]) -> str:
    """Counts as a row of bars."""
    highest = max(counts, default=0)
    if highest == 0:
        return ""
    return "".join(BARS[-(-count * (len(BARS) - 1) // highest)] for count in counts)


def show(result: dict[str, Any]) -> None:
    """Print a campaign's result: trials by condition, distributions, shares, failures, goals."""
    console.print(f"[bold]{result['campaign']}[/]: {result['title']}, seed {result['seed']}")
    titles = ("condition", ">trials", ">eligible", ">success", ">95 % bounds")
    table = table_of(titles, title="trials by condition")
    for cell in [*result["cells"], {"cell": "all", **result}]:
        share = cell["success_share"]
        bounds = f"{100 * share['low']:.2f}–{100 * share['high']:.2f} %" if cell["eligible"] else "—"
        table.add_row(cell["cell"], str(cell["trials"]), str(cell["eligible"]), str(cell["success"]), bounds)
    console.print(table)
    for why, count in result["ineligible"].items():
        console.print(f"  not counted: {count} × {why}")
    show_metrics(result)
    for name, share in result["shares"].items():
        low, high = share.get("low"), share.get("high")
        bounds = "" if low is None else f" ({100 * low:.2f}–{100 * high:.2f} %)"
        console.print(f"{name.replace('_', ' ')}: {100 * share['value']:.3f} %{bounds} of {share['n']}")
    for failure in result["failures"][:MOST_FAILURES]:
        console.print(f"[red]trial {failure['trial']}[/] ({failure['cell']}): {failure['why']}")
    if len(result["failures"]) > MOST_FAILURES:
        console.print(f"… and {len(result['failures']) - MOST_FAILURES} more, see --json")
    if result["kept"]:
        console.print(
            f"{len(result['kept'])} trials kept as scenarios; open one with\n"
            f"  vibrohil run {escape(result['kept'][0])} --clock lockstep --firmware compiled",
            soft_wrap=True,
        )
    show_goals(result)


def show_metrics(result: dict[str, Any]) -> None:
    """Print every metric's distribution, by condition and for all."""
    numbers = (">n", ">p50 (bounds)", ">p95 (bounds)", ">worst", ">lowest ▸ highest")
    names = (Column(name, no_wrap=True) for name in ("metric", "condition"))
    table = table_of([*names, *numbers], title="distributions")
    for name in result["metrics"]:
        for cell in [*result["cells"], {"cell": "all", **result}]:
            metric = cell["metrics"].get(name)
            if metric is None or (len(result["cells"]) == 1 and cell["cell"] == "all"):
                continue
            table.add_row(
                f"{name.replace('_', ' ')} [{metric['unit']}]".replace("[", r"\["),
                cell["cell"],
                str(metric["n"]),
                f"{metric['p50']:.4g} ({metric['p50_low']:.4g}–{metric['p50_high']:.4g})",
                f"{metric['p95']:.4g} ({metric['p95_low']:.4g}–{metric['p95_high']:.4g})",
                f"{metric['worst']:.4g}",
                f"{metric['histogram']['low']:.3g} {histogram(metric['histogram']['counts'])} "
                f"{metric['histogram']['high']:.3g}",
            )
    console.print(table)


def show_goals(result: dict[str, Any]) -> None:
    """Print the goals and the verdict."""
    table = table_of(("goal", "value", "limit", ""))
    for goal in result["goals"]:
        limits = [f"≥ {goal['low']:g}"] if goal["low"] is not None else []
        limits += [f"≤ {goal['high']:g}"] if goal["high"] is not None else []
        mark = {True: "[green]met[/]", False: "[bold red]missed[/]", None: "not measured"}[goal["passed"]]
        table.add_row(
            goal["figure"].replace("_", " "),
            figure(goal["value"], goal["unit"]),
            " ".join([*limits, goal["unit"]]),
            mark,
        )
    console.print(table)
    if result["tuning_seed"]:
        console.print(
            "this seed is one of those used in tuning and tests: no evidence, take one from 10000 on"
        )
    console.print(
        f"{result['simulated_s']:.0f} s simulated in {result['wall_s']:.1f} s, "
        f"{result['realtime_factor_a_core']:.0f} × real time a core (references and judgement included)"
    )
    console.print("[bold green]PASSED[/]" if result["passed"] else "[bold red]FAILED[/]")


def show_endurance(result: dict[str, Any]) -> None:
    """Print an endurance run."""
    console.print(
        f"{result['ticks']} ticks: smallest eigenvalue of P {result['smallest_eigenvalue']:.3g} "
        f"(tick {result['at_tick']}), position RMSE {figure(result['x_rmse_mm'], 'mm')}, at the end in "
        f"{result['mode']}, {result['realtime_factor']:.0f} × real time"
    )
    console.print("[bold green]PASSED[/]" if result["passed"] else "[bold red]FAILED[/]")
