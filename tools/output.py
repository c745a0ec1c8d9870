"""Output of the commands: one JSON object for machines, tables for people, and exit statuses."""

import json
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, TextIO

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from hil.figures import text as figure_texts
from hil.record import formats
from text_input import RefusalError

EXIT_PASSED = 0
EXIT_CHECK_FAILED = 1
EXIT_INTERRUPTED = 2
EXIT_INTERNAL_ERROR = 3
EXIT_BAD_INPUT = 4
EXIT_NOTHING_RAN = 5
"""Nothing ran, or something that ran was not judged."""

NO_VALUE = figure_texts.NO_VALUE
figure = figure_texts.figure_text
plain = formats.plain

PIPED_WIDTH = 240
"""Width in characters where the output is no terminal: each row of a table stays on one line, for grep."""


LEAST_TEXT = 24
"""Width in characters within which a column of longer texts is folded before a table is divided."""
COLUMN_GAP = 2
MOST_RECORDS, MOST_IN_CELL, MOST_UNFOLDED = 40, 6, 3
"""Most records, values in a cell, and values of an object in a record, that are printed; --json has all."""
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
    return TextConsole(stderr=stream is sys.stderr, width=width, highlight=False, emoji=False)


console = console_on(sys.stdout)
progress_console = console_on(sys.stderr)


class BadInputError(RefusalError, ValueError):
    """An unusable input of the user; the message states the input, the wanted input and the remedy."""


def exit_of(verdict: Mapping[str, Any]) -> int:
    """The exit status of a verdict; EXIT_NOTHING_RAN if nothing was judged."""
    if verdict["passed"] is None:
        return EXIT_NOTHING_RAN
    return EXIT_PASSED if verdict["passed"] else EXIT_CHECK_FAILED


def print_json(payload: Mapping[str, Any]) -> None:
    """Print one JSON object, and nothing else, on standard output."""
    sys.stdout.write(json.dumps(plain(payload), allow_nan=False) + "\n")
    sys.stdout.flush()


def answer(
    payload: Mapping[str, Any],
    as_json: bool,
    show: Callable[[], None] | None = None,
    status: int = EXIT_PASSED,
) -> None:
    """End a command: print its result and exit with `status`.

    The result is printed as one JSON object, as `show` does, or without `show` as its tables.
    """
    if as_json:
        print_json(payload)
    elif show is None:
        show_tables(payload)
    else:
        show()
    if status:
        raise typer.Exit(status)


def mark_verdict(verdict: str, loud: bool = False) -> str:
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
        return Column(text, justify="right", no_wrap=True) if is_number else Column(text, overflow="fold")

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


def show_tables(payload: Mapping[str, Any]) -> None:
    """Print a result by its names in JSON: its single values, a table for its records, and its verdict."""
    values = plain(payload, finite=False)
    console.print(figure_table(None, ((name, value, "") for name, value in single_values(values))))
    for name, value in values.items():
        if rows := records_in(value):
            show_records(name, rows)
    if "passed" in values:
        words = {True: "passed", False: "failed", None: "not-judged"}
        console.print(mark_verdict(words[values["passed"]], loud=True))


def single_values(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values that are no records, by their dotted names; of many numbers their count and the last one.

    Those that the result does not have are left out.
    """
    for name, value in values.items():
        if isinstance(value, Mapping) and not records_in(value):
            yield from single_values(value, f"{above}{name}.")
        elif isinstance(value, list) and value and all(isinstance(one, str) for one in value):
            yield from ((f"{above}{name}" if place == 0 else "", one) for place, one in enumerate(value))
        elif not records_in(value) and value not in (None, "", {}, []):
            yield f"{above}{name}", text_of(value)


def records_in(value: Any) -> list[Mapping[str, Any]]:
    """The records in a list, or in an object of records, which then get a name; none in other values."""
    if isinstance(value, Mapping):
        if not all(isinstance(one, Mapping) for one in value.values()):
            return []
        return [{"name": name, **one} for name, one in value.items()]
    if isinstance(value, list) and all(isinstance(one, Mapping) for one in value):
        return value
    return []


def show_records(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the first records, a column for each key; what is the same in all stands in the title."""
    rows = [dict(unfold(row)) for row in rows]
    keys = [
        key
        for key in dict.fromkeys(key for row in rows for key in row)
        if not any(isinstance(row.get(key), Mapping) or records_in(row.get(key)) for row in rows)
    ]
    same = [key for key in keys if len(rows) > 1 and all(row.get(key) == rows[0].get(key) for row in rows)]
    shared = [f"{key} = {text_of(rows[0][key])}" for key in same if rows[0].get(key) not in (None, "")]
    more = [] if len(rows) <= MOST_RECORDS else [f"the first {MOST_RECORDS} of {len(rows)}, --json has all"]
    said = [f"each with {', '.join(shared)}"] if shared else []
    console.print(f"\n[bold]{escape(title)}[/]  {escape('; '.join([*said, *more]))}", soft_wrap=True)
    shown = rows[:MOST_RECORDS]
    columns = {key: [escape(text_of(row.get(key))) for row in shown] for key in keys if key not in same}
    numbers = {key for key in columns if all(isinstance(row.get(key), int | float | None) for row in shown)}
    print_columns(columns, numbers)


def print_columns(columns: Mapping[str, Sequence[str]], unbroken: Collection[str]) -> None:
    """Print columns of cells in markup, as one table or, in a narrow terminal, in blocks of columns.

    Each block begins with the column of texts that has the most different cells. `unbroken`: the columns
    whose cells stay on one line, such as numbers, aligned to the right; other cells are folded.
    """
    least = {}
    for title, cells in columns.items():
        natural = max(Text.from_markup(cell).cell_len for cell in (escape(title), *cells))
        least[title] = natural if title in unbroken else min(natural, LEAST_TEXT)
    texts = [title for title in columns if title not in unbroken] or list(columns)
    label = max(texts, key=lambda title: len(set(columns[title])), default="")
    for place, titles in enumerate(blocks_of(least, label, console.width)):
        if place > 0:
            console.print()
        headers = [
            f">{title}" if title in unbroken else Column(escape(title), overflow="fold") for title in titles
        ]
        console.print(table_of(headers, zip(*(columns[title] for title in titles), strict=True)))


def blocks_of(least: Mapping[str, int], label: str, width: int) -> Iterator[list[str]]:
    """Divide columns, by their least widths, into blocks that fit into `width`; one block if they all do.

    >>> list(blocks_of({"n": 2, "name": 6, "a": 5, "b": 5}, "name", 16))
    [['name', 'n'], ['name', 'a'], ['name', 'b']]
    >>> list(blocks_of({"n": 2, "name": 6, "a": 5, "b": 5}, "name", 24))
    [['n', 'name', 'a', 'b']]
    """
    if sum(least.values()) + COLUMN_GAP * (len(least) - 1) <= width:
        yield list(least)
        return
    block = [label]
    for title in least:
        if title == label:
            continue
        wanted = sum(least[one] + COLUMN_GAP for one in block) + least[title]
        if wanted > width and len(block) > 1:
            yield block
            block = [label]
        block.append(title)
    yield block


def unfold(row: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The cells of a record, those of small objects in it by their dotted names."""
    for key, value in row.items():
        if isinstance(value, Mapping) and len(value) <= MOST_UNFOLDED and not records_in(value):
            yield from ((f"{key}.{name}", one) for name, one in value.items())
        else:
            yield key, value


def text_of(value: Any) -> str:
    """A value in a cell; of many values their count and the last one."""
    if not isinstance(value, list):
        return figure(value)
    if len(value) > MOST_IN_CELL:
        return f"{len(value)}, the last {text_of(value[-1])}"
    texts = (f"({text_of(one)})" if isinstance(one, list) else text_of(one) for one in value)
    return ", ".join(texts) or NO_VALUE
