"""`vibrohil tune`: design the firmware's parameters, fit them to a log, or choose them by campaigns."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tools.commands.options import MOST_TRIALS, Json, Workers, number, unfold
from tools.commands.places import PICTURES, file_option
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED, answer, console, show_tables
from tools.progress import Progress, shown_progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tools.tuning.candidates import Sampling
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
class SamplingOptions:
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
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Write the file even if a safety scenario fails; the file then says so."
        ),
    ] = False
    as_json: Json = False


def list_given(**options: Any) -> dict[str, Any]:
    """The options that the user set; the called function has defaults for the others."""
    return {name: value for name, value in options.items() if value is not None}


def choose_sampling(options: SamplingOptions) -> "Sampling":
    """Seeds and processes as the user set them."""
    from tools.tuning.candidates import Sampling

    return Sampling(**list_given(**vars(options)))


def conclude(
    outputs: Outputs,
    work: "Callable[[Progress], tuple[Tuning, Found]]",
    draw: "Callable[[Figure, Tuning, Found], None]",
    more: Callable[[Found], dict[str, Any]],
    bench: "Bench | None" = None,
) -> None:
    """Run a tuning, draw its result, judge it, write its file and print it.

    A file that was not written is a failed check.
    """
    from firmware_py.shell.parameters import DEFAULTS
    from tools.plots import drawn
    from tools.tuning.safety import judge_safety, write

    with shown_progress() as progress:
        tuning, found = work(progress)
        also = more(found)
        if outputs.plot is not None:
            with drawn(outputs.plot) as figure:
                draw(figure, tuning, found)
            also["plot"] = str(outputs.plot)
        safety = judge_safety(
            tuning.values, lambda fraction, doing: progress(fraction, f"safety: {doing}"), bench
        )
        safe = all(result.passed for result in safety)
        is_written = safe or outputs.force
        if is_written:
            write(outputs.out, tuning, safety)
    payload = {
        **tuning.as_json(),
        **also,
        "parameters": {
            name: {**value._asdict(), "default": DEFAULTS[name]} for name, value in tuning.parameters.items()
        },
        "safety": [asdict(result) for result in safety],
        "safe": safe,
        "out": str(outputs.out) if is_written else None,
    }

    def show() -> None:
        show_tables(payload)
        if not is_written:
            console.print("[bold red]not written[/]; --force writes it all the same")

    status = EXIT_PASSED if is_written else EXIT_CHECK_FAILED
    answer(payload, outputs.as_json, show, status)


@tune.command()
@unfold
def speed(
    bandwidth_hz: Annotated[
        float | None, number("Bandwidth from target to speed, −3 dB; by default the firmware's.", low=0.1)
    ] = None,
    phase_margin_deg: Annotated[
        float | None, number("Phase margin; a surplus increases the integral gain.", low=1.0, high=120.0)
    ] = None,
    inertia_kg_m2: Annotated[float | None, number("Inertia of rotor and flywheel.", low=1e-7)] = None,
    tracker_rad_s: Annotated[float | None, number("Poles of the encoder tracker.", low=1.0)] = None,
    outputs: Outputs = Outputs(Path("speed.toml")),
) -> None:
    """Design the PI gains of the speed loop for a bandwidth and a phase margin."""
    from tools.tuning import pictures
    from tools.tuning.safety import Bench
    from tools.tuning.speed import NominalDrive, tune_speed

    nominal = NominalDrive(**list_given(inertia_kg_m2=inertia_kg_m2, tracker_rad_s=tracker_rad_s))
    wanted = list_given(bandwidth_hz=bandwidth_hz, phase_margin_deg=phase_margin_deg)
    conclude(
        outputs,
        lambda _: tune_speed(nominal, **wanted),
        lambda figure, _, design: pictures.draw_speed(figure, nominal, design),
        lambda _: {},
        Bench(changes={"motor": {"inertia_kg_m2": nominal.inertia_kg_m2}}),
    )


@tune.command()
@unfold
def identify(
    source: Annotated[Path, typer.Argument(help="A run folder, or a candump log of a real bench.")],
    scene: Annotated[
        str | None,
        typer.Option(help="The plant of the safety scenarios; by default that of the run, else their own."),
    ] = None,
    outputs: Outputs = Outputs(Path("identified.toml")),
) -> None:
    """Identify spring, friction, crank radius and stop from the CAN frames of one log."""
    from tools.tuning import pictures
    from tools.tuning.identification.identify import bench_of, tune_identify

    def work(progress: Progress) -> "tuple[Tuning, Any]":
        progress(None, "fitting")
        tuning, identified, readings = tune_identify(source)
        return tuning, (identified, readings)

    conclude(
        outputs,
        work,
        lambda figure, _, both: pictures.draw_identified(figure, *both),
        lambda both: {"law": both[0].law.value},
        bench_of(source, scene),
    )


@tune.command()
@unfold
def detector(
    cost_miss: Annotated[float, number("Cost of a missed impact.")] = 1.0,
    cost_false_alarm: Annotated[float, number("Cost of a false alarm.")] = 1.0,
    trials: Annotated[
        int | None, typer.Option(help="Trials for each floor.", min=11, max=MOST_TRIALS)
    ] = None,
    sampling: SamplingOptions = SamplingOptions(),
    outputs: Outputs = Outputs(Path("detector.toml")),
) -> None:
    """Choose the impact detector's floor by the costs of misses and false alarms, on sampled modules."""
    from tools.tuning import pictures
    from tools.tuning.detector import tune_detector

    conclude(
        outputs,
        lambda progress: tune_detector(
            cost_miss,
            cost_false_alarm,
            progress=progress,
            sampling=choose_sampling(sampling),
            **list_given(trials=trials),
        ),
        pictures.draw_detector,
        lambda points: {"characteristic": [asdict(point) for point in points]},
    )


@tune.command()
@unfold
def estimator(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(help="Run folders or candump logs; by default logs of sampled modules are recorded."),
    ] = None,
    modules: Annotated[
        int | None, typer.Option(help="Number of sampled modules.", min=2, max=MOST_TRIALS)
    ] = None,
    fresh_trials: Annotated[
        int | None,
        typer.Option(
            help="Trials that compare the result with default and naive values; 0: none.",
            min=0,
            max=MOST_TRIALS,
        ),
    ] = None,
    sampling: SamplingOptions = SamplingOptions(),
    outputs: Outputs = Outputs(Path("estimator.toml")),
) -> None:
    """Choose the estimator's Q and R from logs, by the likelihood of the touch-downs, without truth."""
    from tools.tuning import pictures
    from tools.tuning.estimator import tune_estimator

    conclude(
        outputs,
        lambda progress: tune_estimator(
            logs or (),
            progress=progress,
            sampling=choose_sampling(sampling),
            **list_given(modules=modules, fresh_trials=fresh_trials),
        ),
        pictures.draw_estimator,
        lambda points: {"tried": [asdict(point) for point in points]},
    )


@tune.command()
@unfold
def start(
    trials: Annotated[
        int | None, typer.Option(help="Trials for each point of the grid.", min=8, max=MOST_TRIALS)
    ] = None,
    fresh_trials: Annotated[
        int | None, typer.Option(help="Trials for the judgement.", min=8, max=MOST_TRIALS)
    ] = None,
    sampling: SamplingOptions = SamplingOptions(),
    outputs: Outputs = Outputs(Path("start.toml")),
) -> None:
    """Choose the start's S-curve: fewest failures, then softest impacts, least time, least energy."""
    from tools.tuning import pictures
    from tools.tuning.start import tune_start

    conclude(
        outputs,
        lambda progress: tune_start(
            progress=progress,
            sampling=choose_sampling(sampling),
            **list_given(trials=trials, fresh_trials=fresh_trials),
        ),
        pictures.draw_start,
        lambda tried: {"tried": [asdict(one) for one in tried]},
    )
