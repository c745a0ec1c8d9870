"""Options that several commands share."""

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from firmware_py.shell.builds import Build, is_build
from tools.output import progress_console

if TYPE_CHECKING:
    from plant_sim.scene import Scene


MOST_TRIALS = 1_000_000
"""Largest number of trials, modules or seeds: a day of the quickest ones, whose results fit into memory."""

MOST_SEED = 1_000_000_000
"""Largest seed of a search, as of a scenario; CMA-ES accepts no seed above 2³² − 1."""


def number(description: str, low: float | None = None, high: float | None = None) -> Any:
    """A Typer option for a number within bounds, which refuses nan and inf."""
    return typer.Option(help=description, callback=finite, min=low, max=high)


def finite(value: float | None) -> float | None:
    """The number of an option; typer.BadParameter if it is not finite, which bounds do not exclude."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


def note_unused_bus(bus: str, clock: str) -> None:
    """Say on standard error that a bus other than the default is not used in lockstep."""
    if clock == "lockstep" and bus != "auto":
        progress_console.print(f"note: --bus {bus} is not used: lockstep has a bus of its own", markup=False)


def load_changed_scene(source: str, changes: Sequence[str] | None) -> "Scene":
    """The scene with this name or file, after the `--set` changes; raises SceneError or SettingError."""
    from hil.scenario.settings import apply_settings
    from plant_sim.scene import load_scene, read_scene

    return load_scene(apply_settings({"scene": read_scene(source)}, changes or [])["scene"])


def setting(description: str) -> Any:
    """A Typer option `--set` for any number of settings `KEY=VALUE`."""
    return typer.Option("--set", help=f"{description}; repeatable.")


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Logged = Annotated[Path | None, typer.Argument(help="A run folder or .rrd file; by default the newest run.")]
FirmwareBuild = Annotated[
    Build,
    typer.Option(
        "--firmware",
        help="The firmware's build: interpreted, compiled, in single precision, or (lockstep only) on "
        "an emulated Cortex-M7 or, in single precision, Cortex-M4F.",
    ),
]


def controller(text: str | None) -> str | None:
    """The value of `--firmware` of a run. Raises BadParameter for what is no build, file or `none`."""
    from hil.record.traces.own_trace import NONE

    if text is None or is_build(text) or text == NONE or ":" in text:
        return text
    raise typer.BadParameter(
        f"{text!r} is no build of the firmware; wanted {', '.join(get_args(Build))}, "
        "none, or your own controller as FILE.py:FUNCTION"
    )


Controller = Annotated[
    str,
    typer.Option(
        "--firmware",
        callback=controller,
        metavar="CONTROLLER",
        help="The firmware's build, as of `campaign`; your own controller, FILE.py:FUNCTION; or none: "
        "another program joins the bus (real time).",
    ),
]
ReplayedController = Annotated[
    str | None,
    typer.Option(
        "--firmware",
        callback=controller,
        metavar="CONTROLLER",
        help="The firmware's build, or your own controller, FILE.py:FUNCTION; by default the recorded one.",
    ),
]
ParameterFiles = Annotated[
    list[Path] | None,
    typer.Option(help="A parameter file of `vibrohil tune`; repeatable; --set overrides it."),
]
RealTime = Annotated[
    Literal["held", "strict"],
    typer.Option(
        help="Real time: held while a process is late, or strict, which misses periods. On a bus that is not "
        "the run's own, time is strict."
    ),
]
Change = Annotated[
    list[str] | None,
    setting(
        "Change scene.KEY, firmware.KEY, script.KEY or campaign.KEY=VALUE, as far as used; module.KEY sets "
        "scene and firmware together"
    ),
]
Workers = Annotated[
    int | None, typer.Option(help="Number of processes or threads; by default one per core.", min=1)
]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Address of a Dask scheduler whose workers compute instead, e.g. tcp://host:8786."),
]
NodeBus = Annotated[str, typer.Option(help="The bus to join, e.g. socketcan:can0 or local:PATH.")]
Until = Annotated[float | None, number("Stop after this time in s; by default on Ctrl-C.", low=1e-3)]


def unfold(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each record among a command's parameters by one option per field, in the record's place.

    A record is a frozen dataclass of options, given as a parameter's default; its values are the options'
    defaults. Typer itself supports single options only.
    """
    parameters: list[inspect.Parameter] = []
    records: dict[str, Any] = {}
    for one in inspect.signature(command).parameters.values():
        options = [one]
        if is_dataclass(one.default):
            records[one.name] = one.default
            options = [
                one.replace(name=field.name, annotation=field.type, default=getattr(one.default, field.name))
                for field in fields(one.default)
            ]
        parameters += options

    @wraps(command)
    def with_options(**values: Any) -> None:
        for name, record in records.items():
            values[name] = replace(record, **{field.name: values.pop(field.name) for field in fields(record)})
        command(**values)

    vars(with_options)["__signature__"] = inspect.Signature(parameters)
    return with_options
