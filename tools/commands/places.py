"""Options for files and folders to write; an unwritable place is refused before any work."""

import os
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import typer

from hil.record.new_file import foreign_link_on
from tools.output import BadInputError

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
