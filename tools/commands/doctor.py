"""`vibrohil doctor`: what this machine can run, and what to install for the rest."""

from tools.commands.options import Json
from tools.output import answer, console, exit_of, table_of


def doctor(as_json: Json = False) -> None:
    """Report what this machine can run, and what to install for the rest.

    Scenarios run in lockstep and on the local bus without what is missing. The exit status is 1 if the
    packages are not those of the project, so that nothing can run.
    """
    from tools.doctor import PACKAGES
    from tools.doctor import checks as run_checks

    checks = run_checks()

    def show() -> None:
        marks = {True: "[green]yes[/]", False: "[yellow]no[/]"}
        rows = ((one.name, marks[one.passed], one.detail, "" if one.passed else one.remedy) for one in checks)
        console.print(table_of(("check", "", "detail", "remedy"), rows))

    passed = next(one.passed for one in checks if one.name == PACKAGES)
    payload = {"checks": [check._asdict() for check in checks], "passed": passed}
    answer(payload, as_json, show, exit_of(payload))
