"""`vibrohil doctor`: what this machine can run, and what to install for the rest."""

from tools.commands.options import Json
from tools.output import answer, console, exit_of, table_of


def doctor(as_json: Json = False) -> None:
    """Report what this machine can run, and what to install for the rest.

    The exit status is 1 if nothing can run."""
    from tools.doctor import checks as run_checks
    from tools.doctor import conclude

    checks = run_checks()
    passed, sentence = conclude(checks)

    def show() -> None:
        marks = {True: "[green]yes[/]", False: "[yellow]no[/]"}
        rows = ((one.name, marks[one.passed], one.detail, "" if one.passed else one.remedy) for one in checks)
        console.print(table_of(("check", "", "detail", "remedy"), rows))
        console.print(sentence)

    found = [check._asdict() for check in checks]
    payload = {"checks": found, "passed": passed, "conclusion": sentence}
    answer(payload, as_json, show, exit_of(payload))
