"""Progress of long work: a bar on a terminal, otherwise a line every ten seconds."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from tools.output import progress_console

SHOWN_EVERY_S = 0.2
SAID_EVERY_S = 10.0
"""Interval between two lines in a log file or a pipe."""

Progress = Callable[[float | None, str], None]
"""Called with the finished fraction of the work (None if unknown) and the name of the current step."""


@contextmanager
def shown_progress() -> Iterator[Progress]:
    """Give `progress(fraction, doing)`, which shows the progress on standard error.

    The calling thread updates the bar, at long intervals: rich's own thread would hold its lock and Python's
    for hundreds of milliseconds during a run in real time on a slow machine.
    """
    on_terminal = progress_console.is_terminal
    every_s = SHOWN_EVERY_S if on_terminal else SAID_EVERY_S
    due_s = time.monotonic() + (0.0 if on_terminal else every_s)
    with Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=progress_console,
        transient=True,
        auto_refresh=False,
        disable=not on_terminal,
    ) as bar:
        task = bar.add_task("starting", total=None)

        def progress(fraction: float | None, doing: str) -> None:
            nonlocal due_s
            if time.monotonic() < due_s:
                return
            due_s = time.monotonic() + every_s
            if on_terminal:
                total = None if fraction is None else 1.0
                bar.update(task, total=total, completed=fraction or 0.0, description=doing, refresh=True)
            else:
                share = "" if fraction is None else f"{fraction:4.0%}  "
                progress_console.print(f"{share}{doing}", soft_wrap=True)

        yield progress
