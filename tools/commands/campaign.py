"""`vibrohil campaign NAME`: Monte Carlo of the closed loop over truth and starts, compiled."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tomli_w
import typer

from hil.record.new_file import write_anew
from hil.timing.signals import Interrupted
from tools.commands.options import MOST_TRIALS, Change, FirmwareBuild, Json, Scheduler, Workers
from tools.output import BadInputError, answer, exit_of, progress_console
from tools.outputs import digest

if TYPE_CHECKING:
    from tools.campaign.campaign import Outcome, Trial


def campaign(
    name: Annotated[
        Literal["start-up", "estimate", "detect", "hold", "recover", "walk", "limits"],
        typer.Argument(help="The campaign."),
    ],
    trials: Annotated[
        int | None,
        typer.Option(
            help="Number of trials; by default enough for the campaign's goals.", min=1, max=MOST_TRIALS
        ),
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
    from hil.bench.options import RunOptions, prepare
    from hil.bench.workers import WorkerDiedError
    from hil.record.run_folder import RUNS
    from plant_sim.scene import load_scene
    from tools.campaign.campaigns import CAMPAIGNS, trial_of
    from tools.campaign.processes import read_finished, run_all
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
    folder = RUNS / f"campaign-{name}-{seed}{digest(change or [])}"

    def keep_some(outcomes: "Sequence[Outcome]") -> list[str]:
        return [str(keep_trial(folder, trial_of(plan, trial))) for trial in kept_of(outcomes, keep)]

    try:
        outcomes = run_all(plan, count, workers, scheduler)
    except (Interrupted, WorkerDiedError):
        ended = read_finished(plan, count)
        say_what_is_kept(len(ended), count, keep_some(ended))
        raise
    result = result_of(chosen, plan.cells, outcomes, seed, time.perf_counter() - started_s)
    result["kept"] = keep_some(outcomes)
    answer(result, as_json, status=exit_of(result))


def say_what_is_kept(ended: int, trials: int, kept: Sequence[str]) -> None:
    """Print how far a campaign came that was ended early, and the scenarios that it has written."""
    progress_console.print(
        f"{ended} of {trials} trials have ended; the same command continues after them", soft_wrap=True
    )
    for path in kept:
        progress_console.print(f"kept: {path}", markup=False, soft_wrap=True)


def kept_of(outcomes: "Sequence[Outcome]", keep: str | None) -> list[int]:
    """The numbers of the trials to be written as scenarios."""
    if keep in ("failures", "all"):
        return [one.trial for one in outcomes if keep == "all" or (one.eligible and one.why)]
    return [] if keep is None else [int(keep)]


def keep_trial(folder: Path, trial: "Trial") -> Path:
    """Write a trial's scenario; `vibrohil run`, compiled and in lockstep, repeats it bit for bit."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{trial.scenario.name}.toml"
    write_anew(path, tomli_w.dumps(trial.scenario.document))
    return path
