"""`vibrohil doctor`: what this machine can and can't do, with the remedy."""

from typing import Annotated

import typer
from rich.table import Table

from tools.output import EXIT_CHECK_FAILED, console, print_json


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(doctor)


def doctor(as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False) -> None:
    """Say what this machine can and can't do, and what to do about it."""
    from tools.doctor import checks as run_checks

    checks = run_checks()
    passed = all(check.passed for check in checks)
    if as_json:
        print_json({"checks": [check._asdict() for check in checks], "passed": passed})
    else:
        table = Table(box=None, pad_edge=False)
        for name in ("check", "", "detail", "remedy"):
            table.add_column(name)
        for check in checks:
            mark = "[green]yes[/]" if check.passed else "[yellow]no[/]"
            table.add_row(check.name, mark, check.detail, "" if check.passed else check.remedy)
        console.print(table)
    if not passed:
        raise typer.Exit(EXIT_CHECK_FAILED)
