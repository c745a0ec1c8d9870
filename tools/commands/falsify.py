"""`vibrohil falsify SCENARIO…`: searches for the run with the smallest margin."""

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hil.processes.signals import Interrupted
from tools.commands.options import MOST_SEED, MOST_TRIALS, Change, Json, Scheduler, Workers
from tools.commands.places import digest, folder_option
from tools.output import (
    EXIT_CHECK_FAILED,
    EXIT_NOTHING_RAN,
    EXIT_PASSED,
    BadInputError,
    answer,
    console,
    progress_console,
    show_tables,
    table_of,
)
from tools.progress import shown_progress

if TYPE_CHECKING:
    from tools.falsify.evaluations import Evaluations
    from tools.falsify.search import Hunt
    from tools.falsify.space import Space


def falsify(
    scenarios: Annotated[list[str], typer.Argument(help="Scenarios by name or file.")],
    requirement: Annotated[
        list[str] | None,
        typer.Option(help="Only checks of this requirement; repeatable. By default all that have limits."),
    ] = None,
    budget: Annotated[
        int, typer.Option(help="Runs of each method, in all scenarios together.", min=4, max=MOST_TRIALS)
    ] = 500,
    seed: Annotated[int, typer.Option(help="Seed of the search.", min=0, max=MOST_SEED)] = 1,
    change: Change = None,
    out: Annotated[
        Path | None, folder_option("The folder for counterexample and picture; by default under runs/.")
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Write the worst run, with its log, even if it breaks nothing.")
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Search for the run with the smallest margin, by Sobol points, differential evolution and CMA-ES.

    Each varies the values of the scenario's tables `search`; without one, its fault, the module, the sensors'
    errors, and small disturbances. A counterexample is written as a small scenario; the exit status is then
    1. The same command continues an interrupted search, also with a larger budget.
    """
    from hil.processes.workers import WorkerDiedError
    from hil.record.run_folder import RUNS
    from hil.runs.bench import prepare
    from hil.runs.job import RunOptions
    from hil.scenario.files import sources_in
    from tools import jobs
    from tools.campaign.processes import claimed
    from tools.falsify.evaluations import Evaluations, folder_of, runner
    from tools.falsify.search import search
    from tools.falsify.space_of_scenario import space_of

    sources = list(dict.fromkeys(source for name in scenarios for source in sources_in(name)))
    spaces = [space_of(source, requirement or [], change or []) for source in sources]
    by_name = {space.name: source for space, source in zip(spaces, sources, strict=True)}
    refuse_nothing_to_search(spaces)
    prepare(RunOptions(clock="lockstep", firmware="compiled"))
    for space in spaces:
        show_space(space)
    folder = folder_of(spaces)
    out = (
        out
        or RUNS
        / f"falsify-{spaces[0].name}-{seed}{digest([*scenarios, *(requirement or []), *(change or [])])}"
    )
    with (
        claimed(folder),
        jobs.pool(runner(spaces), workers, scheduler) as run,
        shown_progress() as progress,
    ):
        evaluations = Evaluations(folder, run, progress)
        try:
            hunts = search(spaces, budget, seed, evaluations)
            result = result_of(hunts, evaluations, by_name, out, keep=keep)
        except (Interrupted, WorkerDiedError):
            progress_console.print(
                f"{len(evaluations.known)} runs have ended; the same command continues after them",
                soft_wrap=True,
            )
            raise
    answer(result, as_json, partial(show_result, result), status_of(result))


def show_result(result: dict[str, Any]) -> None:
    """Print a result, and how a counterexample is repeated and looked at."""
    show_tables(result)
    if result["worst"] and not result["picture"]:
        console.print("no picture: all runs have the same margin", soft_wrap=True)
    if result["found"] and not result["worst"]["values"]:
        console.print("the scenario breaks its own check, without any change", soft_wrap=True)
    if result["run"]:
        path = shlex.quote(result["counterexample"] or result["kept"])
        console.print(f"repeat it bit for bit:    vibrohil run {path} --clock lockstep", soft_wrap=True)
        console.print(f"look at every signal:     vibrohil view {shlex.quote(result['run'])}", soft_wrap=True)


def status_of(result: dict[str, Any]) -> int:
    """The exit status: 1 with a counterexample, 5 if no run was judged."""
    if result["worst"] is None:
        return EXIT_NOTHING_RAN
    return EXIT_CHECK_FAILED if result["found"] else EXIT_PASSED


def refuse_nothing_to_search(spaces: "list[Space]") -> None:
    """Raise BadInputError for a scenario without a chosen check, and for two of one name."""
    for space in spaces:
        if not space.chosen:
            raise BadInputError(
                f"{space.name}: no check to search, as it has none with a limit of the wanted requirements; "
                "name another --requirement, or leave the scenario out"
            )
    names = [space.name for space in spaces]
    if len(set(names)) < len(names):
        raise BadInputError(f"two of the scenarios have the same name, among {', '.join(names)}; rename one")


def show_space(space: "Space") -> None:
    """Print on standard error what is varied, and the checks that give no direction."""
    from tools.falsify.space_of_scenario import without_direction

    rows = ([one.key, space.kind_of(one.key), str(one.default), one.text] for one in space.dimensions)
    progress_console.print(f"{space.name}: {', '.join(one.name for one in space.checks)}", markup=False)
    progress_console.print(table_of(["key", "of", "scenario", "searched"], rows))
    if names := without_direction(space):
        progress_console.print(
            f"no direction, counted as broken or not: {', '.join(names)}", markup=False, soft_wrap=True
        )


def result_of(
    hunts: "list[Hunt]", evaluations: "Evaluations", by_name: dict[str, str], out: Path, *, keep: bool
) -> dict[str, Any]:
    """The JSON object of a search, after its files have been written.

    These are the counterexample or the picture of margins, and with `keep` the worst run in any case.
    """
    from hil.runs.bench import run_scenario
    from hil.runs.job import RunOptions, silent
    from hil.scenario.scenario import load_scenario
    from tools.falsify.counterexample import shrink, write
    from tools.falsify.pictures import plot_instant, plot_margins

    options = RunOptions(clock="lockstep", firmware="compiled")
    worst = min((one.best for one in hunts if one.best is not None), key=lambda one: one.margin, default=None)
    unjudged = evaluations.unjudged
    result: dict[str, Any] = {
        "runs": len(evaluations.known),
        "taken_over": evaluations.taken_over,
        "not_judged": sum(unjudged.values()),
        "why_not_judged": [{"reason": reason, "runs": runs} for reason, runs in unjudged.items()],
        "methods": [row_of(one) for one in hunts],
        "worst": None,
        "counterexample": None,
        "kept": None,
        "run": None,
        "found": False,
        "picture": None,
        "baseline": {"margin": None if hunts[0].best is None else hunts[0].best.margin},
        "passed": None if worst is None else worst.margin >= 0.0,
    }
    if worst is None:
        return result
    out.mkdir(parents=True, exist_ok=True)
    result["found"] = worst.margin < 0.0
    if worst.margin < 0.0:
        worst = shrink(worst, evaluations)
        result["picture"] = str(out / "instant.png")
        plot_instant(worst, out / "instant.png")
    elif plot_margins(worst, evaluations, out / "margins.png"):
        result["picture"] = str(out / "margins.png")
    if worst.margin < 0.0 or keep:
        path = write(worst, by_name[worst.space.name], out / f"{worst.space.name}-worst.toml")
        run_scenario(kept := load_scenario(path), options, out / "run", kept.seed, silent)
        result["counterexample" if result["found"] else "kept"] = str(path)
        result["run"] = str(out / "run")
    result["worst"] = {
        "margin": worst.margin,
        "check": worst.name,
        "requirement": worst.space.checks[worst.check].requirement,
        "scenario": worst.space.name,
        "values": worst.space.changed(worst.values),
    }
    return result


def row_of(hunt: "Hunt") -> dict[str, Any]:
    """A row of the table of methods."""
    best = hunt.best
    return {
        "method": hunt.method,
        "runs": hunt.runs,
        "found_after": hunt.found_after,
        "margin": None if best is None else best.margin,
        "check": None if best is None else best.name,
        "scenario": None if best is None else best.space.name,
    }
