"""`vibrohil tune`: design the firmware's parameters, fit them to a log, or choose them by campaigns."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tools.commands.design.tune_tables import show, show_check, show_difference, show_trials
from tools.commands.options import Json, Workers, number, unfolded
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED, BadInputError, answer, exit_of
from tools.outputs import PICTURES, RECORDINGS, file_option, folder_option
from tools.progress import Progress, counted_progress, counting, shown_progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tools.tuning.figures.views import Shown
    from tools.tuning.result import Tuning
    from tools.tuning.safety import Bench

Found = TypeVar("Found")

tune = typer.Typer(
    name="tune",
    help="Design or identify the firmware's parameters; a parameter file is written "
    "only if the safety scenarios pass with it.",
    no_args_is_help=True,
)


@dataclass(frozen=True)
class Sampling:
    """Options for the trials on sampled modules."""

    seed: Annotated[
        int | None, typer.Option(help="Seed of the trials for the choice, below 10000.", min=0)
    ] = None
    fresh_seed: Annotated[
        int | None, typer.Option(help="Seed of the trials for the judgement, from 10000 on.", min=0)
    ] = None
    workers: Workers = None


@dataclass(frozen=True)
class Outputs:
    """Options for the files of a command's result and for its printed form."""

    out: Annotated[Path, file_option("The parameter file.")]
    plot: Annotated[Path | None, file_option("Draw a picture of the result into this file.", PICTURES)] = None
    rrd: Annotated[
        Path | None, file_option("Write the result also as a Rerun recording; open it with view.", RECORDINGS)
    ] = None
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Write the file even if a safety scenario fails; the file then says so."
        ),
    ] = False
    as_json: Json = False


def given(**options: Any) -> dict[str, Any]:
    """The options that the user set; the called function has defaults for the others."""
    return {name: value for name, value in options.items() if value is not None}


def conclude(
    outputs: Outputs,
    work: "Callable[[Progress], tuple[Tuning, Found]]",
    draw: "Callable[[Figure, Tuning, Found], None]",
    shown: "Callable[[Found], Shown]",
    more: Callable[[Found], dict[str, Any]],
    bench: "Bench | None" = None,
) -> None:
    """Run a tuning, draw and record its result, judge it, write its file and print it.

    A file that was not written is a failed check.
    """
    from tools.plots import drawn
    from tools.tuning.parameter_file import write
    from tools.tuning.recordings.recording import record_tuning
    from tools.tuning.safety import judge_safety

    with shown_progress() as progress:
        tuning, found = work(progress)
        also = more(found)
        if outputs.plot is not None:
            with drawn(outputs.plot) as figure:
                draw(figure, tuning, found)
            also["plot"] = str(outputs.plot)
        if outputs.rrd is not None:
            record_tuning(outputs.rrd, tuning, *shown(found))
            also["rrd"] = str(outputs.rrd)
        safety = judge_safety(
            tuning.values, lambda fraction, doing: progress(fraction, f"safety: {doing}"), bench
        )
        safe = all(result.passed for result in safety)
        is_written = safe or outputs.force
        if is_written:
            write(outputs.out, tuning, safety, outputs.force)
    payload = {
        **tuning.as_json(),
        **also,
        "safety": [asdict(result) for result in safety],
        "safe": safe,
        "out": str(outputs.out) if is_written else None,
    }
    status = EXIT_PASSED if is_written else EXIT_CHECK_FAILED
    answer(payload, outputs.as_json, lambda: show(payload), status)


@tune.command()
@unfolded
def speed(
    bandwidth_hz: Annotated[
        float | None, number("Bandwidth from target to speed, −3 dB; by default the firmware's.", low=0.1)
    ] = None,
    phase_margin_deg: Annotated[
        float | None, number("Phase margin; a surplus increases the integral gain.", low=1.0, high=120.0)
    ] = None,
    inertia_kg_m2: Annotated[float | None, number("Inertia of rotor and flywheel.", low=1e-7)] = None,
    tracker_rad_s: Annotated[float | None, number("Poles of the encoder tracker.", low=1.0)] = None,
    measure: Annotated[
        bool, typer.Option(help="Measure the loop in lockstep, with sines added to the torque.")
    ] = True,
    outputs: Outputs = Outputs(Path("speed.toml")),
) -> None:
    """Design the PI gains of the speed loop for a bandwidth and a phase margin, and measure the loop."""
    from hil.scenario.parameter_file import nested
    from tools.tuning.figures import pictures, views
    from tools.tuning.speed import NominalDrive, SpeedDesign, tune_speed
    from tools.tuning.speed_measurement import MeasuredLoop, compared, measure_loop

    nominal = NominalDrive(**given(inertia_kg_m2=inertia_kg_m2, tracker_rad_s=tracker_rad_s))
    points: dict[str, Any] = {}
    Loop = tuple[SpeedDesign, MeasuredLoop | None]

    def work(progress: Progress) -> "tuple[Tuning, Loop]":
        tuning, design = tune_speed(
            nominal, **given(bandwidth_hz=bandwidth_hz, phase_margin_deg=phase_margin_deg)
        )
        if not measure:
            return tuning, (design, None)
        measured = measure_loop(nested(tuning.values), progress=progress)
        tuning, points["measured"] = compared(tuning, nominal, measured)
        return tuning, (design, measured)

    conclude(
        outputs,
        work,
        lambda figure, _, loop: pictures.draw_speed(figure, nominal, *loop),
        lambda loop: views.of_speed(nominal, *loop),
        lambda _: points,
    )


@tune.command()
@unfolded
def identify(
    source: Annotated[
        Path | None, typer.Argument(help="A run folder, or a candump log of a real bench.")
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(help="The plant of the safety scenarios; by default that of the run, else their own."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the resampling for the bounds.", min=0)] = 1,
    trials: Annotated[
        int | None,
        typer.Option(
            help="Instead of a log: number of sampled modules on which to measure the identification.", min=1
        ),
    ] = None,
    trials_out: Annotated[
        Path, file_option("File with a line per finished trial; finished trials are not run again.")
    ] = Path("identify-trials.jsonl"),
    workers: Workers = None,
    outputs: Outputs = Outputs(Path("identified.toml")),
) -> None:
    """Identify spring, friction, crank radius and stop from the CAN frames of one log.

    With --trials the command judges the identification itself: shares with Wilson's bounds, errors against
    the truth, and how often the 95 % bounds contain the truth.
    """
    from tools.tuning.figures import pictures, views
    from tools.tuning.identification.identify import bench_of, tune_identify

    if trials is not None:
        if source is not None:
            raise BadInputError(
                f"--trials samples its own modules; leave out {source}, or leave out --trials"
            )
        for option, value in (("--scene", scene), ("--plot", outputs.plot), ("--rrd", outputs.rrd)):
            if value is not None:
                raise BadInputError(
                    f"--trials identifies no single log; leave out {option}, or leave out --trials"
                )
        judge_identification(trials, trials_out, workers, outputs.as_json)
        return
    if source is None:
        raise BadInputError("no log: give a run folder or a candump log, or --trials 300")
    log = source

    def work(progress: Progress) -> "tuple[Tuning, Any]":
        progress(None, "fitting")
        tuning, identified, readings = tune_identify(log, seed)
        return tuning, (identified, readings)

    conclude(
        outputs,
        work,
        lambda figure, _, both: pictures.draw_identified(figure, *both),
        lambda both: views.of_identify(*both),
        lambda both: {"law": both[0].law.value},
        bench_of(log, scene),
    )


def judge_identification(trials: int, path: Path, workers: int | None, as_json: bool) -> None:
    """Run trials and print their rates; missed goals are a failed check."""
    from tools.tuning.trials import run_trials, summary

    with counted_progress("trials", trials) as progress:
        outcomes = run_trials(trials, path, progress=lambda done, _: progress(done), workers=workers)
    payload = {"command": "identify", **summary(outcomes), "out": str(path)}
    answer(payload, as_json, lambda: show_trials(payload), exit_of(payload))


@tune.command()
@unfolded
def detector(
    cost_miss: Annotated[float, number("Cost of a missed impact.")] = 1.0,
    cost_false_alarm: Annotated[float, number("Cost of a false alarm.")] = 1.0,
    trials: Annotated[int | None, typer.Option(help="Trials for each floor.", min=11)] = None,
    sampling: Sampling = Sampling(),
    outputs: Outputs = Outputs(Path("detector.toml")),
) -> None:
    """Choose the impact detector's floor by the costs of misses and false alarms, on sampled modules."""
    from tools.tuning.detector import tune_detector
    from tools.tuning.figures import pictures, views

    conclude(
        outputs,
        lambda progress: tune_detector(
            cost_miss,
            cost_false_alarm,
            progress=counting(progress, "trials"),
            **given(trials=trials, **vars(sampling)),
        ),
        pictures.draw_detector,
        views.of_detector,
        lambda points: {"characteristic": [asdict(point) for point in points]},
    )


@tune.command()
@unfolded
def estimator(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(help="Run folders or candump logs; by default logs of sampled modules are recorded."),
    ] = None,
    modules: Annotated[int | None, typer.Option(help="Number of sampled modules.", min=2)] = None,
    fresh_trials: Annotated[
        int | None,
        typer.Option(help="Trials that compare the result with default and naive values; 0: none.", min=0),
    ] = None,
    sampling: Sampling = Sampling(),
    outputs: Outputs = Outputs(Path("estimator.toml")),
) -> None:
    """Choose the estimator's Q and R from logs, by the likelihood of the touch-downs, without truth."""
    from tools.tuning.estimator import tune_estimator
    from tools.tuning.figures import pictures, views

    conclude(
        outputs,
        lambda progress: tune_estimator(
            logs or (),
            progress=counting(progress, "logs"),
            **given(modules=modules, fresh_trials=fresh_trials, **vars(sampling)),
        ),
        pictures.draw_estimator,
        views.of_estimator,
        lambda points: {"tried": [asdict(point) for point in points]},
    )


@tune.command()
@unfolded
def start(
    candidates: Annotated[int | None, typer.Option(help="Number of candidates in all.", min=2)] = None,
    trials: Annotated[int | None, typer.Option(help="Trials for each candidate.", min=8)] = None,
    fresh_trials: Annotated[
        int | None, typer.Option(help="Trials for the choice among the best, and for the judgement.", min=8)
    ] = None,
    journal: Annotated[
        Path | None,
        file_option("Journal of the search, from which the command continues; by default beside the file."),
    ] = None,
    sampling: Sampling = Sampling(),
    outputs: Outputs = Outputs(Path("start.toml")),
) -> None:
    """Tune start-up and hold loop for the fewest failures, then softest impacts, least time, least energy."""
    from tools.tuning.figures import pictures, views
    from tools.tuning.start import tune_start

    conclude(
        outputs,
        lambda progress: tune_start(
            journal or outputs.out.with_suffix(".journal"),
            progress=counting(progress, "trials"),
            **given(candidates=candidates, trials=trials, fresh_trials=fresh_trials, **vars(sampling)),
        ),
        pictures.draw_start,
        views.of_start,
        lambda tried: {"tried": [asdict(one) for one in tried]},
    )


@tune.command()
def check(
    quick: Annotated[bool, typer.Option("--quick", help="Few trials, for a quick test.")] = False,
    workers: Workers = None,
    out: Annotated[Path, folder_option("Folder of the results; a killed search continues there.")] = Path(
        "tuned"
    ),
    as_json: Json = False,
) -> None:
    """Compare the firmware's defaults with the results of all tunings, and with naive values."""
    from tools.tuning.check import QUICK, Effort, check_defaults
    from tools.tuning.parameter_file import write
    from tools.tuning.safety import judge_safety

    with shown_progress() as progress:
        payload, tunings = check_defaults(out, QUICK if quick else Effort(), progress, workers)
        together = {name: value for tuning in tunings for name, value in tuning.values.items()}
        safety = judge_safety(together, lambda share, doing: progress(share, f"safety: {doing}"))
        for tuning in tunings:
            write(out / f"{tuning.command}.toml", tuning, safety, force=True)
    payload = {
        **payload,
        "safety": [asdict(result) for result in safety],
        "passed": payload["passed"] and all(result.passed for result in safety),
    }
    answer(payload, as_json, lambda: show_check(payload), exit_of(payload))


@tune.command()
def diff(
    a: Annotated[Path, typer.Argument(help="A parameter file.")],
    b: Annotated[Path, typer.Argument(help="The other parameter file.")],
    scenario: Annotated[
        list[str] | None,
        typer.Option(help="Name of a scenario to run with both; repeatable. By default three."),
    ] = None,
    suite: Annotated[bool, typer.Option(help="Run both on scenarios of the suite, in lockstep.")] = True,
    as_json: Json = False,
) -> None:
    """Compare two parameter files, and their effect on scenarios of the suite.

    A parameter that is missing in a file has its default. A scenario that fails only with the second file
    is a failed check.
    """
    from tools.tuning.difference import SCENARIOS, difference, effects

    payload = {**difference(a, b), "suite": []}
    if suite:
        with shown_progress() as progress:
            payload["suite"] = effects(a, b, scenario or SCENARIOS, progress)
    worse = any(one["passed"]["a"] and not one["passed"]["b"] for one in payload["suite"])
    status = EXIT_CHECK_FAILED if worse else EXIT_PASSED
    answer(payload, as_json, lambda: show_difference(payload, a, b), status)
