"""`vibrohil view RUN`: the Rerun viewer on a run's log."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(view)


def view(
    run: Annotated[
        Path | None, typer.Argument(help="A run folder or .rrd file; by default the newest run.")
    ] = None,
    web: Annotated[bool, typer.Option(help="Open in a browser instead of a window; loopback only.")] = False,
    live: Annotated[bool, typer.Option(help="Wait for runs that are started with --live.")] = False,
) -> None:
    """Open a run in the Rerun viewer, or a viewer that waits for live runs."""
    from tools.logs.view import view as open_viewer

    open_viewer(run, web=web, live=live)
