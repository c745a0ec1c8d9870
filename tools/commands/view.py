"""`vibrohil view RUN`: the Rerun viewer on a run's log."""

from typing import Annotated

import typer

from tools.commands.options import Logged


def view(
    run: Logged = None,
    web: Annotated[bool, typer.Option(help="Open in a browser instead of a window; loopback only.")] = False,
    live: Annotated[
        bool, typer.Option(help="With --web: wait for runs that are started with --live.")
    ] = False,
) -> None:
    """Open a run in the Rerun viewer, or a viewer that waits for live runs."""
    from tools.runs.view import view as open_viewer

    open_viewer(run, web=web, live=live)
