"""Every requirement is proved by a check or a test, and every check of a scenario proves a requirement."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from hil.judge import junit
from hil.judge.requirements import requirements, trace
from hil.scenario.scenario import ScenarioError, check_scenario, load_scenario, read_scenario, scenario_names

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
    for name, requirement in requirements().items():
        assert name in proved or requirement.tests, f"{name}: {requirement.text}"
        for test in requirement.tests:
            assert (ROOT / test).is_file(), f"{name} names {test}"


def test_every_requirement_is_stated_in_a_page_that_is_there():
    for name, requirement in requirements().items():
        page = requirement.source.partition("#")[0]
        assert (ROOT / "docs" / page).is_file(), f"{name} names {page}"


def test_a_requirement_that_is_not_there_is_refused():
    document = read_scenario("soft-start-multistable")
    document["checks"] = [{"name": "impact_count", "low": 1, "requirement": "S-99"}]
    with pytest.raises(ScenarioError, match="S-99"):
        check_scenario(document, "mine")


CHECKS = [
    {"name": "impact_count", "unit": "", "limit": "≥ 1", "value": 3, "passed": True, "requirement": "P-01"},
    {"name": "speed.error", "unit": "", "limit": "≤ 1", "value": 2.0, "passed": False, "requirement": "P-04"},
    {"name": "fault", "unit": "", "limit": "= none", "value": "none", "passed": True, "requirement": None},
]
VERDICT = {"scenario": "mine", "duration_s": 1.0, "reasons": [], "checks": CHECKS}


def test_the_trace_says_what_proves_a_requirement_and_whether_it_is_met():
    found = trace([VERDICT])
    assert found["P-01"]["passed"] is True
    assert found["P-01"]["checks"] == [
        {"scenario": "mine", "name": "impact_count", "limit": "≥ 1", "passed": True}
    ]
    assert found["P-04"]["passed"] is False
    assert found["S-01"]["passed"] is None


def test_a_run_that_is_no_proper_run_proves_nothing():
    found = trace([{**VERDICT, "reasons": ["firmware was killed by SIGKILL at 4.00 s"]}])
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
