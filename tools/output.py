"""Output of the commands: one JSON object for machines, tables for people, and exit statuses."""

import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment
from rich.table import Column, Table

from hil.judge.figures import text as figure_texts

EXIT_PASSED = 0
EXIT_CHECK_FAILED = 1
EXIT_INTERRUPTED = 2
EXIT_INTERNAL_ERROR = 3
EXIT_BAD_INPUT = 4
EXIT_NOTHING_RAN = 5
"""Nothing ran, or something that ran was not judged."""

PIPED_WIDTH = 240
"""Width in characters where the output is no terminal: each row of a table stays on one line, for grep."""


CONTROL = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u202a-\\u202e\\u2066-\\u2069]")
"""Characters that command a terminal, or reverse the direction of text; tab and line feed are left."""


class TextConsole(Console):
    """A console that prints no control characters of texts: names and reasons may come from foreign files."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The segments of a renderable; rich's own commands to the terminal are segments of their own."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(CONTROL.sub("", segment.text), segment.style)


def console_on(stream: TextIO | None) -> Console:
    """A console on standard output or error, as wide as the terminal or $COLUMNS, else PIPED_WIDTH."""
    in_terminal = stream is not None and stream.isatty()
    given = os.environ.get("COLUMNS", "")
    if not (given.isdecimal() and int(given) > 0):
        os.environ.pop("COLUMNS", None)  # rich would print nothing in 0 columns
    width = PIPED_WIDTH if not in_terminal and "COLUMNS" not in os.environ else None
    return TextConsole(stderr=stream is sys.stderr, width=width, highlight=False)


console = console_on(sys.stdout)
progress_console = console_on(sys.stderr)


class BadInputError(ValueError):
    """An unusable input of the user; the message states the input, the wanted input and the remedy."""


def exit_of(verdict: Mapping[str, Any]) -> int:
    """The exit status of a verdict; EXIT_NOTHING_RAN if nothing was judged."""
    if verdict["passed"] is None:
        return EXIT_NOTHING_RAN
    return EXIT_PASSED if verdict["passed"] else EXIT_CHECK_FAILED


def plain(value: Any) -> Any:
    """`value` in JSON's own types: arrays become lists, paths texts, NaN and infinities null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
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


NO_VALUE = figure_texts.NO_VALUE
figure = figure_texts.figure_text


def marked(verdict: str, loud: bool = False) -> str:
    """A verdict (passed, failed, not-judged) in words and colour; `loud`: in capitals."""
    words = verdict.replace("-", " ")
    style = {"passed": "bold green" if loud else "green", "failed": "bold red"}.get(words, "bold yellow")
    return f"[{style}]{words.upper() if loud else words}[/]"


def table_of(columns: Iterable[str | Column], rows: Iterable[Iterable[str]] = (), **options: Any) -> Table:
    """A table without lines; a column's name with a leading > heads numbers, aligned to the right.

    Names are no markup, as they may contain units in brackets."""

    def header(one: str | Column) -> Column:
        if isinstance(one, Column):
            return one
        is_number = one.startswith(">")
        text = escape(one.removeprefix(">"))
        return Column(text, justify="right", no_wrap=True) if is_number else Column(text)

    headers = map(header, columns)
    table = Table(*headers, title_justify="left", box=None, pad_edge=False, **options)
    for row in rows:
        table.add_row(*row)
    return table


def figure_table(
    title: str | None, rows: Iterable[tuple[str, Any, str]], meanings: Mapping[str, str] | None = None
) -> Table:
    """A table of (name, value, unit): the name, the value with its unit, and the name's meaning if given."""
    shown = (
        map(escape, (name, figure(value, unit), *([meanings.get(name, "")] if meanings else [])))
        for name, value, unit in rows
    )
    columns = [Column(style="cyan", no_wrap=True), Column(no_wrap=bool(meanings))]
    columns += [Column(style="dim", overflow="fold")] if meanings else []
    return table_of(columns, shown, title=title and escape(title), show_header=False)
