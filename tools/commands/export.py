"""`vibrohil export RUN --to KIND`: the frames of a run for other programs."""

from pathlib import Path
from typing import Annotated, Literal, get_args

import typer

from tools.commands.options import Json, Logged
from tools.commands.places import new_option, refuse_existing
from tools.output import BadInputError, answer

Kind = Literal["mf4", "mcap", "parquet", "csv"]


def export(
    run: Logged = None,
    to: Annotated[
        Kind | None,
        typer.Option(
            help="The format, by default the ending of --out, else mf4; parquet and csv write a folder with "
            "a file per frame."
        ),
    ] = None,
    out: Annotated[
        Path | None, new_option("File or folder to write; by default frames.KIND in the run's folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write every frame of a run, decoded with units by vibro.dbc, for MDF, MCAP or table programs."""
    from hil.record.new_file import is_foreign
    from hil.runs.recorded_run import open_run
    from tools.exchange.exporting import export as write

    ending = "" if out is None else out.suffix.removeprefix(".").lower()
    kind = to or (ending if ending in get_args(Kind) else "mf4")
    logged = open_run(run)
    if out is None and is_foreign(logged.folder):
        raise BadInputError(f"{logged.folder} cannot be written by you; name a file or folder with --out")
    place = logged.folder / f"frames.{kind}" if out is None else out
    refuse_existing("--out", place)
    frames = write(logged, kind, place)
    payload = {"run": str(logged.folder), "to": kind, "out": str(place), "frames": frames}
    answer(payload, as_json)
