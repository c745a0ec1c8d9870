"""`vibrohil schedule`: modules on one bus."""

import pytest

from tools import cli
from tools.output import EXIT_BAD_INPUT


@pytest.mark.parametrize(
    ("modules", "shared"),
    [(["0,1", "0,1"], "0, 1, 2, 3"), (["0,2", "1,4"], "4"), (["4,1", "7,4"], "4"), (["0,1", "0,4"], "0")],
)
def test_modules_that_share_a_node_number_are_refused(
    modules: list[str], shared: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their frames have the same identifiers, of which no analysis holds."""
    options = [word for one in modules for word in ("--module", one)]
    assert cli.run(["schedule", *options]) == EXIT_BAD_INPUT
    assert f"more than one module has node {shared};" in " ".join(capsys.readouterr().err.split())
