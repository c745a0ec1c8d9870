"""Every requirement is proved by a check or a test, and every check of a scenario proves a requirement."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hil.judge import junit
from hil.judge.judge import judge
from hil.judge.requirements import requirements, trace
from hil.judge.verdict import CheckResult, Verdict
from hil.record.run_traces import RunTraces
from hil.scenario.files import ScenarioError, read_scenario, scenario_names
from hil.scenario.scenario import check_scenario, load_scenario
from tools.dev.reference import proving_tests

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def scenarios():
    return [load_scenario(name) for name in scenario_names()]


def test_every_check_of_a_scenario_proves_a_requirement(scenarios):
    without = [
        (one.name, check.name) for one in scenarios for check in one.checks if check.requirement is None
    ]
    assert without == []


def test_every_requirement_is_proved_by_a_check_or_a_test(scenarios):
    proved = {check.requirement for one in scenarios for check in one.checks}
    proved |= {name for name, tests in proving_tests().items() if tests}
    assert proved >= set(requirements())


def test_every_requirement_is_stated_in_a_page_that_is_there():
    for name, requirement in requirements().items():
        page = requirement.source.partition("#")[0]
        assert (ROOT / "docs" / page).is_file(), f"{name} names {page}"


def test_a_requirement_that_is_not_there_is_refused():
    document = read_scenario("soft-start-multistable")
    document["checks"] = [{"name": "impact_count", "low": 1, "requirement": "S-99"}]
    with pytest.raises(ScenarioError, match="S-99"):
        check_scenario(document, "mine")


CHECKS = (
    CheckResult("impact_count", Verdict.PASSED, 3, "", "≥ 1", "P-01"),
    CheckResult("speed.error", Verdict.FAILED, 2.0, "", "≤ 1", "P-04"),
    CheckResult("fault", Verdict.PASSED, "none", "", "= none"),
)
VERDICT = replace(judge(RunTraces(run={"scenario": "mine"}), Path("mine")), checks=CHECKS, reasons=())


def test_the_trace_says_what_proves_a_requirement_and_whether_it_is_met():
    found = trace([VERDICT])
    assert found["P-01"]["passed"] is True
    assert found["P-01"]["checks"] == [
        {"scenario": "mine", "name": "impact_count", "limit": "≥ 1", "passed": True, "verdict": "passed"}
    ]
    assert found["P-04"]["passed"] is False
    assert found["S-01"]["passed"] is None


def test_a_run_that_is_no_proper_run_proves_nothing():
    found = trace([replace(VERDICT, reasons=("firmware was killed by SIGKILL at 4.00 s",))])
    assert found["P-01"]["passed"] is False
    assert [proof["passed"] for proof in found["P-01"]["checks"]] == [False]


def test_junit_names_the_requirement_and_where_it_is_stated():
    root = ElementTree.fromstring(junit.document([VERDICT]).encode())
    properties = {
        (case.get("name"), one.get("name")): one.get("value")
        for case in root.iter("testcase")
        for one in case.iter("property")
    }
    assert properties["impact_count", "requirement"] == "P-01"
    assert properties["impact_count", "requirement_page"] == "docs/requirements.md#p-01"
    assert ("fault", "requirement") not in properties
