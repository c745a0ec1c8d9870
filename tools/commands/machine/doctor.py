"""`vibrohil doctor`: what this machine can run, and what to install for the rest."""

from rich.table import Table

from tools.commands.options import Json
from tools.output import answer, console, exit_of


def doctor(as_json: Json = False) -> None:
    """Report what this machine can run, and what to install for the rest.

    The exit status is 1 if nothing can run."""
    from tools.doctor import checks as run_checks
    from tools.doctor import conclude

    checks = run_checks()
    passed, sentence = conclude(checks)

    def show() -> None:
        table = Table("check", "", "detail", "remedy", box=None, pad_edge=False)
        for check in checks:
            mark = "[green]yes[/]" if check.passed else "[yellow]no[/]"
            table.add_row(check.name, mark, check.detail, "" if check.passed else check.remedy)
        console.print(table)
        console.print(sentence)

    found = [check._asdict() for check in checks]
    payload = {"checks": found, "passed": passed, "conclusion": sentence}
    answer(payload, as_json, show, exit_of(payload))
