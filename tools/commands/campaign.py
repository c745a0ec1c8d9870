"""`vibrohil campaign NAME`: Monte Carlo of the closed loop over truth and starts, compiled."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
import typer

from hil.processes.signals import Interrupted
from hil.record.new_file import write_anew
from tools.commands.options import (
    MOST_TRIALS,
    Change,
    FirmwareBuild,
    Json,
    ParameterFiles,
    Scheduler,
    Workers,
)
from tools.commands.places import digest
from tools.output import BadInputError, answer, exit_of, progress_console, show_tables

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
    parameters: ParameterFiles = None,
    spread: Annotated[
        Path | None,
        typer.Option(
            help="A parameter file of bring-up: truth and firmware have its parameters, and the truth is "
            "sampled within their intervals; starts and accelerometers' offsets as without it. Not for walk "
            "and limits."
        ),
    ] = None,
    change: Change = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            help="Run the same trials with other parameters too, and print the paired differences: a "
            "parameter file, or default for the firmware's own; --set firmware.KEY leaves these as they are."
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    keep: Annotated[
        str | None,
        typer.Option(help="Write trials as scenarios under runs/: failures, all, or a trial's number."),
    ] = None,
    firmware: FirmwareBuild = "compiled",
    as_json: Json = False,
) -> None:
    """Run the closed loop on many sampled modules and starts, and judge the results by goals.

    A campaign writes no result by itself; `--json > FILE` keeps it.

    Keys of --set campaign.KEY, lists of conditions first:

    - start-up, estimate, detect, hold, recover: laws (viscous, coulomb, coulomb-0.2, coulomb-0.3, stribeck),
    ratios, impulses; duration_s (hold: hold_s)
    - start-up also: swing_m_s2
    - recover also: kick_low_m_s, kick_high_m_s
    - walk: presets (walking, table1), courses (steady, change, stop, stumble); walk_s, variability
    - limits: contacts_ms (1.5 to 3, 3 to 5, 5 to 10, 10 to 30); mismatch_mass, high_offset_m_s2
    - all but limits: mismatch_spring, mismatch_damping, mismatch_restitution, mismatch_rest_length_m,
    mismatch_stop_m, mismatch_dry_friction, mismatch_bias_g, mismatch_amplitude
    """
    from hil.processes.workers import WorkerDiedError
    from hil.record.run_folder import RUNS
    from hil.runs.bench import prepare
    from hil.runs.job import RunOptions
    from plant_sim.scene import load_scene
    from tools.campaign.campaigns import CAMPAIGNS, trial_of
    from tools.campaign.identified import read_spread, refuse_other_axes
    from tools.campaign.paired import compare
    from tools.campaign.processes import read_finished, run_all
    from tools.campaign.reference import refuse_other_drives
    from tools.campaign.results import result_of

    chosen = CAMPAIGNS[name]
    count = trials or chosen.trials
    if spread is not None:
        refuse_other_axes(name, chosen.sampler.axes)
    module = [] if spread is None else read_spread(spread)
    settings = [*module, *settings_of(parameters or []), *(change or [])]
    plan = chosen.plan(settings, seed, firmware)
    others = [] if baseline in (None, "default") else [Path(str(baseline))]
    common = [one for one in [*module, *(change or [])] if not one.startswith("firmware.")]
    plan_before = chosen.plan([*settings_of(others), *common], seed, firmware)
    if baseline is not None and plan_before == plan:
        raise BadInputError(
            f"--baseline {baseline} has the same parameters as this campaign, so nothing would differ; "
            "change one of them by --set firmware.KEY=VALUE or --parameters FILE"
        )
    for cell in plan.cells:
        refuse_other_drives(load_scene(cell.scene))
    if keep not in (None, "failures", "all") and not (keep.isdecimal() and int(keep) < count):
        raise BadInputError(f"--keep {keep}: wanted failures, all, or a trial's number, 0 … {count - 1}")
    prepare(RunOptions(clock="lockstep", firmware=firmware))
    started_s = time.perf_counter()
    folder = RUNS / f"campaign-{name}-{seed}{digest(settings)}"

    def keep_some(outcomes: "Sequence[Outcome]") -> list[str]:
        return [str(keep_trial(folder, trial_of(plan, trial))) for trial in kept_of(outcomes, keep)]

    try:
        outcomes = run_all(plan, count, workers, scheduler)
        before = run_all(plan_before, count, workers, scheduler) if baseline is not None else None
    except (Interrupted, WorkerDiedError):
        ended = read_finished(plan, count)
        say_what_is_kept(len(ended), count, keep_some(ended))
        raise
    files = [*map(str, parameters or []), *([] if spread is None else [f"spread {spread}"])]
    changed = [*files, *(change or [])]
    result = result_of(chosen, plan.cells, outcomes, seed, time.perf_counter() - started_s, changed)
    result["kept"] = keep_some(outcomes)
    if before is not None:
        result["baseline"] = baseline
        result["differences"] = compare(before, outcomes, chosen.units)
    answer(result, as_json, lambda: show_tables(printed(result)), exit_of(result))


def printed(result: Mapping[str, Any]) -> dict[str, Any]:
    """A campaign's result as it is printed: a goal with its limit in words, differences by their title."""
    from hil.scenario.checks import Bounds

    goals = [
        {
            **{key: goal[key] for key in ("figure", "value", "unit")},
            "limit": Bounds(low=goal["low"], high=goal["high"]).text,
            "passed": goal["passed"],
            "note": "" if goal["wanted"] is None else describe_bound(goal),
        }
        for goal in result["goals"]
    ]
    tables = {**result, "goals": goals}
    rows = tables.pop("differences", [])
    if rows:
        tables["differences (value − baseline: 95 % interval from … to)"] = [
            {
                **{
                    key: value for key, value in row.items() if key not in ("low", "high", "differs", "pairs")
                },
                "from": row["low"],
                "to": row["high"],
                "differs": row["differs"],
                "pairs": row["pairs"],
            }
            for row in rows
        ]
    return tables


def describe_bound(goal: Mapping[str, Any]) -> str:
    """Says that a limit is a regression bound, and whether the wanted value behind it is met."""
    value, wanted = goal["value"], goal["wanted"]
    if value is None:
        return f"a regression bound; wanted {wanted:g}"
    is_met = value <= wanted if goal["high"] is not None else value >= wanted
    met = "met" if is_met else f"missed: {goal['reason']}"
    return f"a regression bound; wanted {wanted:g}, {met}"


def settings_of(files: Sequence[Path]) -> list[str]:
    """The parameters of tuned files as settings KEY=VALUE."""
    from hil.scenario.parameter_file import read_document, values_of

    return [
        f"firmware.{name}={value!r}"
        for path in files
        for name, value in values_of(read_document(path), path).items()
    ]


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
