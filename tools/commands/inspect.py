"""`vibrohil inspect RUN`: figures, tables and plots from a run's log alone."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column

from tools.commands.options import Json, Logged
from tools.commands.places import PICTURES, TABLES, file_option
from tools.output import (
    BadInputError,
    answer,
    console,
    exit_of,
    figure,
    figure_table,
    mark_verdict,
    plain,
    print_columns,
    progress_console,
    table_of,
)

if TYPE_CHECKING:
    import pyarrow as pa

    from hil.runs.recorded_run import Run


def inspect(
    run: Logged = None,
    table: Annotated[
        str | None, typer.Option(help="Show one table of the log, e.g. plant or can/Accelerometer.")
    ] = None,
    to: Annotated[
        Path | None, file_option("Write that table to a .parquet, .csv or .arrow file.", TABLES)
    ] = None,
    rows: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO", help="Print these rows of the table, by their places from 0, e.g. 500:520."
        ),
    ] = None,
    plot: Annotated[Path | None, file_option("Draw signals into this file.", PICTURES)] = None,
    signal: Annotated[
        list[str] | None, typer.Option(help="A signal to draw, TABLE.COLUMN; repeatable.")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Print every figure with its meaning, and the names of the tables.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Recompute a run's figures and verdict from its log, or extract tables and plots."""
    from hil.runs.recorded_run import open_run
    from tools.runs.inspection import default_signals, plot_signals, write_table

    if to is not None and table is None:
        raise BadInputError(
            "--to is given without --table NAME; `vibrohil inspect RUN --all` lists the tables"
        )
    if rows is not None and table is None:
        raise BadInputError("--rows is given without --table NAME, whose rows it prints")
    places = None if rows is None else places_of(rows)
    if signal and plot is None:
        raise BadInputError(
            "--signal is given without --plot; name the file to draw into, e.g. --plot run.svg"
        )
    logged = open_run(run)
    drawn: dict[str, Any] = {}
    if plot is not None:
        drawn = {"plot": str(plot), "signals": signal or default_signals(logged)}
        plot_signals(logged, drawn["signals"], plot)
        progress_console.print(f"drawn: {plot}", markup=False)
    if table is not None:
        found = logged.table(table)
        if to is not None:
            write_table(found, to)
        columns = {field.name: str(field.type) for field in found.schema}
        written = None if to is None else str(to)
        payload = {"table": table, "rows": found.num_rows, "columns": columns, "to": written, **drawn}
        if places is not None:
            if places.start >= found.num_rows:
                raise BadInputError(f"--rows {rows}: {table} has {found.num_rows} rows, from 0")
            part = found.slice(places.start, len(places)).to_pylist()
            payload["values"] = [{name: in_json(value) for name, value in row.items()} for row in part]
        answer(payload, as_json, lambda: show_table(table, found, to, places))
    elif drawn:
        answer(drawn, as_json, lambda: None)
    else:
        answer(logged.verdict, as_json, lambda: show(logged, every), exit_of(logged.verdict))


def in_json(value: Any) -> Any:
    """A value of a table in JSON's types: times and bytes as texts."""
    return value if isinstance(value, bool | int | float | str | None) else str(value)


def places_of(text: str) -> range:
    """The places of rows from a text FROM:TO, without TO itself; BadInputError for any other text.

    >>> places_of("500:502")
    range(500, 502)
    """
    match = re.fullmatch(r"(\d{1,12}):(\d{1,12})", text)
    if match is None or int(match[1]) >= int(match[2]):
        raise BadInputError(f"--rows {text}: wanted FROM:TO with FROM < TO, e.g. 500:520")
    return range(int(match[1]), int(match[2]))


def show_table(name: str, rows: "pa.Table", to: Path | None, places: range | None = None) -> None:
    """Print the columns of a table with their first and last values, or with the values at some places."""
    if places is not None:
        print_rows(name, rows, places)
        return
    where = "" if to is None else f", written to {to}"
    title = escape(f"{name}: {rows.num_rows} rows{where}")
    shown = table_of((Column("column", no_wrap=True), "type", "first", "last"), title=title)
    for field in rows.schema:
        ends = [rows[field.name].to_numpy()[at] for at in ((0, -1) if rows.num_rows else ())]
        shown.add_row(field.name, str(field.type), *(escape(figure(plain(end))) for end in ends))
    console.print(shown)


def print_rows(name: str, rows: "pa.Table", places: range) -> None:
    """Print some rows of a table, one column of cells for each of its columns."""
    part = rows.slice(places.start, len(places))
    console.print(
        f"{name}: rows {places.start} to {places.start + part.num_rows} of {rows.num_rows}", markup=False
    )
    values = {field.name: part[field.name].to_pylist() for field in part.schema}
    cells = {title: [escape(figure(plain(one))) for one in column] for title, column in values.items()}
    if part.num_rows:
        print_columns(cells, set(cells))


def show(logged: "Run", every: bool) -> None:
    """Print the verdict, the checks and the most important figures, or every figure and the tables' names."""
    from hil.figures.records import CATALOGUE, value_of
    from hil.record.run_faults import EARLIER_VERSION, lacks_faults
    from tools.commands.run import show_checks, show_figures, title_of

    verdict = logged.judged
    traces = logged.traces
    title = title_of(str(traces.scenario.get("title", verdict.scenario)), traces.run.get("changes", []))
    console.print(f"{mark_verdict(verdict.verdict, loud=True)}  {escape(title)}\n")
    show_checks(verdict)
    if lacks_faults(logged.traces.run, logged.traces.scenario):
        console.print(EARLIER_VERSION)
    console.print()
    if len(logged.traces.plant) == 0:
        console.print("this log holds no truth, so it lacks the figures that need it")
    if every:
        rows = ((one.name, value_of(verdict.figures, one.name), one.unit) for one in CATALOGUE.values())
        meanings = {one.name: one.meaning for one in CATALOGUE.values()}
        console.print(figure_table(None, rows, meanings))
        console.print(f"tables: {', '.join(logged.names)}", style="dim")
    else:
        show_figures(verdict.figures)
        console.print("\nevery figure and the tables' names: --all", style="dim")
    console.print(f"log: {escape(str(logged.log))}", style="dim", soft_wrap=True)
