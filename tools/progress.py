"""Progress of long work: a bar on a terminal, elsewhere a line now and then."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from tools.output import progress_console

DRAWN_EVERY_S = 0.2
SAID_EVERY_S = 10.0
"""A line in a log file or a pipe."""


@contextmanager
def shown_progress() -> Iterator[Callable[[float, str], None]]:
    """Gives `progress(fraction, doing)`.

    It draws in the thread that calls it, and seldom: rich's own thread would hold its lock, and Python's, for
    hundreds of milliseconds of a run in real time on a slow machine.
    """
    on_terminal = progress_console.is_terminal
    every_s = DRAWN_EVERY_S if on_terminal else SAID_EVERY_S
    due_s = time.monotonic() + (0.0 if on_terminal else every_s)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=progress_console,
        transient=True,
        auto_refresh=False,
        disable=not on_terminal,
    ) as bar:
        task = bar.add_task("starting", total=1.0)

        def progress(fraction: float, doing: str) -> None:
            nonlocal due_s
            if time.monotonic() < due_s:
                return
            due_s = time.monotonic() + every_s
            if on_terminal:
                bar.update(task, completed=fraction, description=doing, refresh=True)
            else:
                progress_console.print(f"{fraction:4.0%}  {doing}", highlight=False, soft_wrap=True)

        yield progress
