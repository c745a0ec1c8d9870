"""Output of the commands: one JSON object for machines, tables for people, and exit statuses."""

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TextIO

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

EXIT_PASSED = 0
EXIT_CHECK_FAILED = 1
EXIT_INTERRUPTED = 2
EXIT_INTERNAL_ERROR = 3
EXIT_BAD_INPUT = 4
EXIT_NOTHING_RAN = 5

PIPED_WIDTH = 240
"""Width in characters where the output is no terminal: each row of a table stays on one line, for grep."""


def console_on(stream: TextIO | None) -> Console:
    """A console on standard output or error, as wide as the terminal or $COLUMNS, else PIPED_WIDTH."""
    in_terminal = stream is not None and stream.isatty()
    free = not in_terminal and "COLUMNS" not in os.environ
    width = PIPED_WIDTH if free else None
    return Console(stderr=stream is sys.stderr, width=width, highlight=False)


console = console_on(sys.stdout)
progress_console = console_on(sys.stderr)


class BadInputError(ValueError):
    """An unusable input of the user; the message states the input, the wanted input and the remedy."""


def exit_of(verdict: Mapping[str, Any]) -> int:
    """The exit status of a verdict; EXIT_NOTHING_RAN if nothing was checked."""
    if verdict["passed"] is None:
        return EXIT_NOTHING_RAN
    return EXIT_PASSED if verdict["passed"] else EXIT_CHECK_FAILED


def plain(value: Any) -> Any:
    """`value` in JSON's own types: arrays become lists, NaN and infinities become null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_json(payload: Mapping[str, Any]) -> None:
    """Print one JSON object, and nothing else, on standard output."""
    sys.stdout.write(json.dumps(plain(payload), allow_nan=False) + "\n")
    sys.stdout.flush()


def answer(
    payload: Mapping[str, Any], as_json: bool, show: Callable[[], None], status: int = EXIT_PASSED
) -> None:
    """End a command: print its result, as one JSON object or as `show` does, and exit with `status`."""
    if as_json:
        print_json(payload)
    else:
        show()
    if status:
        raise typer.Exit(status)


def figure(value: Any, unit: str = "") -> str:
    """A figure as text: four significant digits and the unit; an em dash if there is no value."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "—"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def table_of(columns: Iterable[str | Column], rows: Iterable[Iterable[str]] = (), **options: Any) -> Table:
    """A table without lines; a column's name with a leading > heads numbers, aligned to the right."""
    headers = (
        Column(one[1:], justify="right", no_wrap=True) if isinstance(one, str) and one[:1] == ">" else one
        for one in columns
    )
    table = Table(*headers, title_justify="left", box=None, pad_edge=False, **options)
    for row in rows:
        table.add_row(*row)
    return table


def figure_table(title: str, rows: Iterable[tuple[str, Any, str]]) -> Table:
    """A two-column table of (name, value, unit)."""
    shown = ((escape(name), escape(figure(value, unit))) for name, value, unit in rows)
    columns = (Column(style="cyan", no_wrap=True), Column())
    return table_of(columns, shown, title=escape(title), show_header=False)
