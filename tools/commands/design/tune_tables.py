"""The tables of `vibrohil tune`: values beside defaults, rates, margins, safety verdicts, differences."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Column, Table

from tools.output import console, figure, figure_table, table_of


def show(payload: Mapping[str, Any]) -> None:
    """Print parameters, figures of merit, warnings and the verdicts of the safety scenarios."""
    from firmware_py.shell.parameters import DEFAULTS

    console.print(f"[bold]tune {payload['command']}[/]: {escape(payload['source'])}")
    rows = (
        (name, *(f"{x:.5g}" for x in (one["value"], one["low"], one["high"], DEFAULTS[name])), one["unit"])
        for name, one in payload["parameters"].items()
    )
    console.print(table_of(("parameter", ">value", ">low", ">high", ">default", "unit"), rows))
    console.print(f"low, high: {payload['range_is']}", style="dim")
    merits = payload["figures_of_merit"].items()
    figures = [(name.replace("_", " "), one["value"], one["unit"]) for name, one in merits]
    console.print(figure_table("figures of merit", figures))
    for warning in payload["warnings"]:
        console.print(f"[bold yellow]warning:[/] {warning}")
    show_safety(payload["safety"])
    if payload["out"] is None:
        console.print("[bold red]not written[/]; --force writes it all the same")
    else:
        forced = "" if payload["safe"] else "  [bold red]by force[/]"
        console.print(f"[bold green]written[/]{forced}  {escape(payload['out'])}", soft_wrap=True)


def show_safety(safety: Sequence[Mapping[str, Any]]) -> None:
    """Print one line per safety scenario."""
    for result in safety:
        mark = "[green]passed[/]" if result["passed"] else f"[bold red]failed[/]: {result['why']}"
        console.print(f"safety, {result['scenario']}: {mark}")


def show_trials(payload: Mapping[str, Any]) -> None:
    """Print rates with bounds, then errors with limits, then the wrong identifications."""
    titles = ("", ">right", ">95 % bounds", ">limit", ">median", ">95 %", ">worst", ">truth in bounds")
    table = table_of(titles)

    def row(name: str, share: Mapping[str, Any], *errors: str) -> None:
        bounds = f"{100.0 * share['low']:.1f}–{100.0 * share['high']:.1f} %"
        table.add_row(name, f"{share['hits']} of {share['n']}", bounds, *errors)

    row("[bold]law named[/]", payload["named_right"])
    for law, share in payload["named_by_law"].items():
        row(f"  {law}", share)
    for name, share in payload["within"].items():
        errors = (f"{share[key]:.2g}" for key in ("p50", "p95", "worst"))
        held = f"{100.0 * share['in_bounds']['value']:.0f} %"
        row(name, share, f"{share['limit']:g} {share['unit']}", *errors, held)
    console.print(table)
    for one in payload["wrong"]:
        named = one["named"] or one["why"]
        console.print(f"[bold red]trial {one['trial']}[/], {one['law']}: named {named}")
    mark = "[green]goals met[/]" if payload["passed"] else "[bold red]a goal is missed[/]"
    console.print(f"{mark}; outcomes in {escape(payload['out'])}", soft_wrap=True)


def show_check(payload: Mapping[str, Any]) -> None:
    """Print defaults beside tuned values, defaults beside naive values, and the warnings."""
    table = table_of(("parameter", "tune", ">default", ">tuned", "unit", "tolerance", ""))
    for row in payload["parameters"]:
        mark = "[green]agrees[/]" if row["passed"] else "[bold red]differs[/]"
        numbers = (f"{row[key]:.4g}" for key in ("default", "tuned"))
        table.add_row(row["parameter"], row["command"], *numbers, row["unit"], row["tolerance"], mark)
    console.print(table)
    keys = ("what", "command", "default", "naive", "unit", "naive_is")
    margins = ([figure(one[key]) for key in keys] for one in payload["margins"])
    titles = ("on fresh trials", "tune", ">default", ">naive", "unit", "naive is")
    console.print(table_of(titles, margins))
    for warning in payload["warnings"]:
        console.print(f"[bold yellow]warning:[/] {warning}")
    show_safety(payload["safety"])
    mark = (
        "[green]tuning gives the defaults[/]"
        if payload["passed"]
        else "[bold red]tuning gives other values than the defaults[/]"
    )
    console.print(f"{mark}; files in {escape(payload['out'])}", soft_wrap=True)


def show_difference(payload: Mapping[str, Any], a: Path, b: Path) -> None:
    """Print differing parameters and figures of merit, then verdicts and figures of the scenarios."""
    table = table_of((Column("parameter", no_wrap=True), *_sides(a, b), ">change", "unit"))
    for change in payload["changed"]:
        relative = "—" if change["relative"] is None else f"{100.0 * change['relative']:+.3g} %"
        sides = (
            f"{change[side]:.5g}" if change[f"named_in_{side}"] else f"default {change[side]:.5g}"
            for side in ("a", "b")
        )
        table.add_row(change["name"], *sides, relative, change["unit"])
    if payload["changed"]:
        console.print(table)
    else:
        console.print("no parameter differs")
    if payload["figures_of_merit"]:
        console.print(_side_by_side("figure of merit", payload["figures_of_merit"], a, b))
    for one in payload["suite"]:
        verdicts = (
            "[green]passed[/]"
            if one["passed"][side]
            else f"[red]failed ({escape(', '.join(one['failed'][side]))})[/]"
            for side in ("a", "b")
        )
        console.print(f"[bold]{escape(one['scenario'])}[/]: " + " → ".join(verdicts))
        if one["figures"]:
            console.print(_side_by_side("figure", one["figures"], a, b))
        else:
            console.print("  no figure differs by more than half a per cent")
    for side, path in (("a", a), ("b", b)):
        if payload["safe"][side] is False:
            console.print(
                f"[bold red]{escape(str(path))} was written by force[/]: a safety scenario fails with it"
            )


def _side_by_side(title: str, figures: Mapping[str, Mapping[str, Any]], a: Path, b: Path) -> Table:
    rows = ((name, figure(one["a"]), figure(one["b"]), one["unit"]) for name, one in figures.items())
    return table_of((Column(title, no_wrap=True), *_sides(a, b), "unit"), rows)


def _sides(a: Path, b: Path) -> list[Column]:
    """Columns of numbers below the names of two files, which may be long."""
    return [Column(escape(path.name), justify="right", overflow="fold") for path in (a, b)]
