"""Numbers of trials that no machine could run are refused, instead of filling its memory with their list."""

import pytest

from tools import cli
from tools.commands.options import MOST_TRIALS
from tools.output import EXIT_BAD_INPUT


@pytest.mark.parametrize(
    "command",
    [
        ["campaign", "hold", "--trials"],
        ["suite", "--seeds"],
        ["tune", "detector", "--trials"],
        ["tune", "estimator", "--modules"],
        ["tune", "start", "--trials"],
        ["tune", "start", "--fresh-trials"],
    ],
)
def test_more_trials_than_a_machine_can_run_are_refused(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run([*command, str(MOST_TRIALS + 1)]) == EXIT_BAD_INPUT
    assert f"less than or equal to {MOST_TRIALS}" in " ".join(capsys.readouterr().err.split())
