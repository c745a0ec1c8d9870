"""Options that several commands share; output options reject an unwritable place before any work."""

import inspect
import math
import os
import zlib
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from firmware_py.shell.builds import Build, is_build
from hil.record.new_file import foreign_link_on
from tools.output import BadInputError, progress_console

if TYPE_CHECKING:
    from plant_sim.scene import Scene


MOST_TRIALS = 1_000_000
"""Largest number of trials, modules or seeds: a day of the quickest ones, whose results fit into memory."""


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


PICTURES = (".svg", ".png", ".pdf")
RECORDINGS = (".rrd",)
TABLES = (".parquet", ".csv", ".arrow")
MOST_NEW_FOLDERS = 100
"""Largest number of folders, one in the other, that an option makes."""


def digest(texts: Sequence[str]) -> str:
    """What the name of a file or folder of results ends in, so that other inputs have another; may be empty.

    >>> digest([]), digest(["scene.stop.restitution=0.6"])
    ('', '-45880dd9')
    """
    return f"-{zlib.crc32(' '.join(texts).encode()):08x}" if texts else ""


def file_option(description: str, endings: tuple[str, ...] = ()) -> Any:
    """A Typer option for a file to write; its name must end in one of `endings`, if any are given."""
    return _option(description, lambda option, path: refuse_file(option, path, endings))


def folder_option(description: str) -> Any:
    """A Typer option for a folder to write to; a missing folder is created."""
    return _option(description, refuse_folder)


def new_option(description: str, endings: tuple[str, ...] = ()) -> Any:
    """A Typer option for a file or folder that does not exist yet; `endings` as in `file_option`."""
    return _option(description, lambda option, path: refuse_existing(option, path, endings))


def _option(description: str, refuse: Callable[[str, Path], None]) -> Any:
    def check(parameter: typer.CallbackParam, path: Path | None) -> Path | None:
        if path is not None:
            refuse_link(parameter.opts[0], path)
            refuse(parameter.opts[0], path)
        return path

    return typer.Option(help=description, callback=check, parser=path, metavar="<path>")


def path(text: str) -> Path:
    """The path of an option; typer.BadParameter for an empty one, which would be the working folder."""
    if not text:
        raise typer.BadParameter("it is empty; name a file or folder, `.` for this folder")
    return Path(text)


def refuse_link(option: str, path: Path) -> None:
    """Raise BadInputError if another user's link stands on the way to `path`: it may lead anywhere."""
    if link := foreign_link_on(path):
        raise BadInputError(
            f"{option} is {path}: {link} is another user's link to {os.readlink(link)}; name another place"
        )


def refuse_existing(option: str, path: Path, endings: tuple[str, ...] = ()) -> None:
    """Raise BadInputError unless a new file can be made at `path`."""
    try:
        if os.path.lexists(path):  # a link to a missing file too: the file would be made at its end
            raise BadInputError(f"{option} is {path}: that is there already; remove it, or name another")
    except OSError as error:
        raise BadInputError(f"{option} is {path}: {error.strerror}; name another place") from error
    refuse_file(option, path, endings)


def refuse_file(option: str, path: Path, endings: tuple[str, ...]) -> None:
    """Raise BadInputError unless a regular file can be written at `path`."""
    if endings and path.suffix.lower() not in endings:
        wanted = " or ".join(endings)
        raise BadInputError(
            f"{option} is {path}: wanted a file ending in {wanted}, e.g. {path.stem}{endings[0]}"
        )
    try:
        if path.is_symlink():  # whoever shares the folder may have made it
            raise BadInputError(
                f"{option} is {path}: that is a link to {os.readlink(path)}; name a file itself"
            )
        if path.is_dir():
            raise BadInputError(f"{option} is {path}: that is a folder; name a file in it")
        if path.exists() and not path.is_file():
            raise BadInputError(f"{option} is {path}: that is no regular file; name one, or a new one")
        if path.parent.is_file():
            raise BadInputError(f"{option} is {path}: {path.parent} is a file; name a file in a folder")
        if not path.parent.exists():
            raise BadInputError(f"{option} is {path}: its folder is missing; mkdir -p {path.parent}")
    except OSError as error:
        raise BadInputError(f"{option} is {path}: {error.strerror}; name another file") from error
    refuse_unwritable(option, path, path if path.exists() else path.parent)


def refuse_folder(option: str, path: Path) -> None:
    """Raise BadInputError unless `path` is a folder to write to, or can become one."""
    try:
        nearest = next(place for place in (path, *path.absolute().parents) if place.exists())
        if not nearest.is_dir():
            raise BadInputError(f"{option} is {path}: {nearest} is a file; name a folder")
        made = path.absolute().parts[len(nearest.absolute().parts) :]
        if ".." in made or len(made) > MOST_NEW_FOLDERS:
            raise BadInputError(
                f"{option} is {path}: {len(made)} folders below {nearest} are missing, with `..` or more "
                f"than {MOST_NEW_FOLDERS}; name a place without"
            )
    except OSError as error:
        raise BadInputError(f"{option} is {path}: {error.strerror}; name another folder") from error
    refuse_unwritable(option, path, nearest)


def refuse_unwritable(option: str, path: Path, nearest: Path) -> None:
    """Raise BadInputError if `nearest` cannot be written, as found by a test that leaves no file."""
    try:
        with TemporaryFile(dir=nearest) if nearest.is_dir() else nearest.open("ab"):
            pass
    except OSError as error:
        raise BadInputError(
            f"{option} is {path}: {nearest} cannot be written ({error.strerror}); name another place"
        ) from error
