"""The recipe for a user's own CI: its files, beside the page, judge a repository as the page says."""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from resting import resting

from hil.record.run_traces import read_json

HOW_TO = Path(__file__).parents[3] / "docs/how-to"
RECIPE = HOW_TO / "run-in-ci"
PAGE = (HOW_TO / "run-in-ci.md").read_text("utf-8")
STATUSES = [int(status) for status in re.findall(r"^\| (\d) \|", PAGE, re.MULTILINE)]
OF_A_TEST = 'def test_it_rests(bench):\n    assert bench.run("scenarios/rests.toml").impacts == {impacts}\n'


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's repository with one scenario and one test that pass, and the recipe's script."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vibrohil/.venv").mkdir(parents=True)
    (tmp_path / "vibrohil/.venv/bin").symlink_to(Path(sys.executable).parent)
    (tmp_path / "ci.sh").write_text((RECIPE / "ci.sh").read_text("utf-8"))
    resting(tmp_path / "scenarios")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/test_rest.py").write_text(OF_A_TEST.format(impacts="()"))
    return tmp_path


def run_script() -> int:
    """Run ci.sh as a CI system does; return its status."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    return subprocess.run(["sh", "ci.sh"], env=environment, capture_output=True, check=False).returncode


def counts(junit: Path) -> list[tuple[str, str, str]]:
    """Tests, failures and errors of each test suite of a JUnit file."""
    suites = ElementTree.parse(junit).getroot().iter("testsuite")
    return [(one.get("tests", ""), one.get("failures", ""), one.get("errors", "")) for one in suites]


def test_a_repository_whose_runs_all_pass_has_status_0_and_its_artefacts(repository: Path) -> None:
    assert run_script() == 0
    kept = repository / "artefacts"
    assert counts(kept / "suite/junit.xml") == [("2", "0", "0")], "the run and its check"
    assert counts(kept / "tests.xml") == [("1", "0", "0")]
    assert read_json(kept / "suite/suite.json")["passed"] is True
    assert (kept / "suite/index.html").exists()
    assert {"report.html", "run.rrd"} <= {path.name for path in (kept / "suite/rests").iterdir()}
    assert list((repository / "runs").iterdir()) == []


def test_a_failed_test_has_status_1_and_keeps_its_run(repository: Path) -> None:
    (repository / "tests/test_rest.py").write_text(OF_A_TEST.format(impacts="(1,)"))
    assert run_script() == 1
    assert counts(repository / "artefacts/tests.xml") == [("1", "1", "0")]
    (run,) = (repository / "runs").iterdir()
    assert (run / "run.rrd").exists()


@pytest.mark.parametrize(
    ("limit", "status", "counted"),
    [("low = 1\n", 1, ("2", "1", "0")), ("lowest = 1\n", 4, None)],
    ids=["a check that fails", "a key that does not exist"],
)
def test_the_status_is_that_of_the_suite(
    repository: Path, limit: str, status: int, counted: tuple[str, str, str] | None
) -> None:
    path = repository / "scenarios/rests.toml"
    path.write_text(path.read_text().replace("low = 0.0\n", limit))
    (repository / "tests/test_rest.py").write_text("def test_that_needs_no_run():\n    pass\n")
    assert run_script() == status
    junit = repository / "artefacts/suite/junit.xml"
    assert (counts(junit) if junit.exists() else None) == (counted and [counted])
    assert counts(repository / "artefacts/tests.xml") == [("1", "0", "0")]


def test_the_workflow_runs_the_script_and_keeps_the_artefacts_always() -> None:
    workflow = yaml.safe_load((RECIPE / "bench.yml").read_text("utf-8"))
    steps = workflow["jobs"]["bench"]["steps"]
    assert [step["run"] for step in steps if "run" in step] == ["make -C vibrohil setup", "sh ci.sh"]
    assert steps[0]["with"]["submodules"] is True
    assert (steps[-1]["if"], steps[-1]["with"]["path"].split()) == ("always()", ["artefacts", "runs"])
    assert STATUSES == [0, 1, 2, 3, 4, 5]
