"""`vibrohil campaign NAME`: Monte Carlo of the closed loop over truth and starts, compiled."""

import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import Change, FirmwareBuild, Json, Scheduler, Workers
from tools.output import BadInputError, answer, console, exit_of, figure, table_of

if TYPE_CHECKING:
    from tools.campaign.campaign import Outcome, Trial

MOST_FAILURES = 20


def campaign(
    name: Annotated[
        Literal["start-up", "estimate", "detect", "hold", "recover", "walk", "limits"],
        typer.Argument(help="The campaign."),
    ],
    trials: Annotated[
        int | None, typer.Option(help="Number of trials; by default enough for the campaign's goals.", min=1)
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Seed of all trials; seeds below 10000 belong to tuning and tests.", min=0)
    ] = 20_260,
    change: Change = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    keep: Annotated[
        str | None,
        typer.Option(help="Write trials as scenarios under runs/: failures, all, or a trial's number."),
    ] = None,
    firmware: FirmwareBuild = "compiled",
    as_json: Json = False,
) -> None:
    """Run the closed loop on many sampled modules and starts, and judge the results by goals."""
    from hil.bench.bench import prepare
    from hil.bench.options import RunOptions
    from hil.record.run_folder import RUNS
    from plant_sim.scene import load_scene
    from tools.campaign.campaigns import CAMPAIGNS, trial_of
    from tools.campaign.processes import run_all
    from tools.campaign.reference import refuse_other_drives
    from tools.campaign.results import result_of

    chosen = CAMPAIGNS[name]
    count = trials or chosen.trials
    plan = chosen.plan(change or [], seed, firmware)
    for cell in plan.cells:
        refuse_other_drives(load_scene(cell.scene))
    if keep not in (None, "failures", "all") and not (keep.isdecimal() and int(keep) < count):
        raise BadInputError(f"--keep {keep}: wanted failures, all, or a trial's number, 0 … {count - 1}")
    prepare(RunOptions(clock="lockstep", firmware=firmware))
    started_s = time.perf_counter()
    outcomes = run_all(plan, count, workers, scheduler)
    result = result_of(chosen, plan.cells, outcomes, seed, time.perf_counter() - started_s)
    changes = f"-{zlib.crc32(' '.join(change).encode()):08x}" if change else ""
    folder = RUNS / f"campaign-{name}-{seed}{changes}"
    result["kept"] = [str(keep_trial(folder, trial_of(plan, trial))) for trial in kept_of(outcomes, keep)]
    answer(result, as_json, lambda: show(result), exit_of(result))


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
    numbers = (">n", ">p50 (bounds)", ">p95 (bounds)", ">worst", ">lowest")
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
                f"{metric['lowest']:.4g}",
            )
    console.print(table)


def show_goals(result: dict[str, Any]) -> None:
    """Print the goals and the verdict."""
    table = table_of(("goal", "value", "limit", "", "wanted"))
    for goal in result["goals"]:
        limits = [f"≥ {goal['low']:g}"] if goal["low"] is not None else []
        limits += [f"≤ {goal['high']:g}"] if goal["high"] is not None else []
        mark = {True: "[green]met[/]", False: "[bold red]missed[/]", None: "not measured"}[goal["passed"]]
        table.add_row(
            goal["figure"].replace("_", " "),
            figure(goal["value"], goal["unit"]),
            " ".join([*limits, goal["unit"]]),
            mark,
            "" if goal["wanted"] is None else f"{figure(goal['wanted'], goal['unit'])}: {goal['reason']}",
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
    not_measured = sum(goal["passed"] is None for goal in result["goals"])
    words = {True: "[bold green]PASSED[/]", False: "[bold red]FAILED[/]"}
    unjudged = f"[bold yellow]NOT JUDGED[/]: {not_measured} goals were not measured; run more trials"
    console.print(words.get(result["passed"], unjudged))
