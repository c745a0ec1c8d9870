"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Literal

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Logged = Annotated[Path | None, typer.Argument(help="A run folder or .rrd file; by default the newest run.")]
FirmwareBuild = Annotated[
    Literal["python", "compiled", "host-single", "cortex-m7", "cortex-m4f"],
    typer.Option(
        "--firmware",
        help="The firmware's build: interpreted, compiled, in single precision, or (lockstep only) on "
        "an emulated Cortex-M7 or, in single precision, Cortex-M4F.",
    ),
]
ParameterFiles = Annotated[
    list[Path] | None,
    typer.Option(help="A parameter file of `vibrohil tune`; repeatable; --set overrides it."),
]
NodeBus = Annotated[str, typer.Option(help="The bus to join, e.g. socketcan:can0 or local:PATH.")]
Sync = Annotated[
    bool, typer.Option(help="Print 'ready', then wait for the common start time on standard input.")
]
Again = Annotated[
    bool, typer.Option("--again", help="With --sync: join when requested, and continue the trace.")
]
Until = Annotated[float | None, typer.Option(help="Stop after this time in s; by default on Ctrl-C.")]
