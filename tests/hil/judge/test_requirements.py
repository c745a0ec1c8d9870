"""Every requirement is proved by a check or a test, and every check of a scenario proves a requirement."""

import re
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hil.figures.records import CATALOGUE
from hil.judge.evaluation import meets_requirement
from hil.judge.failures import failures_of
from hil.judge.judge import judge
from hil.judge.seeds import worst_of
from hil.judge.verdict import CheckResult, Verdict, trace
from hil.judge.verdict_files import junit_document
from hil.record.run_traces import RunTraces
from hil.scenario.checks import Check, checks_of, requirements
from hil.scenario.files import ScenarioError, read_scenario, scenario_names
from hil.scenario.limits import DESCRIBED, SCALES, look_up
from hil.scenario.scenario import check_scenario, load_scenario
from hil.scenario.settings import apply_settings
from tools.dev.reference import proving_tests
from tools.falsify.default_space import RANGES

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


def proving(name, requirement, met=None, verdict=Verdict.FAILED):
    """A run with one check, which meets its requirement's limit or not."""
    check = CheckResult("speed.error", verdict, 2.0, "", "≤ 1", requirement, meets_requirement=met)
    return replace(VERDICT, figures=replace(VERDICT.figures, scenario=name), checks=(check,))


def test_failures_of_own_limits_are_distinguished_from_broken_requirements():
    runs = [
        proving("passes", "P-04", True, Verdict.PASSED),
        proving("stricter", "P-04", True),
        proving("none", None),
        proving("worded", "S-11"),
        proving("broken", "P-07", False),
        replace(proving("killed", "S-01", True), reasons=("firmware was killed by SIGKILL at 4.00 s",)),
    ]
    found = failures_of(runs)
    assert found.own_limits == ["stricter", "none"]
    assert found.without_limit == {"S-11": ["worded"]}
    assert found.broken == {"P-07": ["broken"]}
    assert found.other == ["killed"]
    traced = trace(runs)
    assert [traced[name]["verdict"] for name in ("P-04", "P-07", "S-01", "S-11")] == ["passed"] + 3 * [
        "failed"
    ]


def test_a_seed_that_is_not_judged_proves_no_requirement_beside_one_that_misses_the_scenarios_own_limit():
    """Seed 1 meets the requirement, but not the scenario's limit; seed 2 was not judged."""
    check = Check(name="speed.ripple", requirement="P-04", high=0.001)
    missed, doubted = (
        replace(CheckResult.of(check, verdict, 0.0015, None), required="≤ 0.002")
        for verdict in (Verdict.FAILED, Verdict.NOT_JUDGED)
    )
    seeds = {1: replace(missed, meets_requirement=True), 2: doubted}
    both = worst_of(check, seeds)
    assert (both.verdict, both.meets_requirement) == (Verdict.FAILED, None)
    merged = replace(VERDICT, checks=(both,))
    assert trace([merged])["P-04"]["verdict"] == "not-judged"
    assert failures_of([merged]).own_limits == ["mine"]


def test_junit_names_the_requirement_and_where_it_is_stated():
    root = ElementTree.fromstring(junit_document([VERDICT]).encode())
    properties = {
        (case.get("name"), one.get("name")): one.get("value")
        for case in root.iter("testcase")
        for one in case.iter("property")
    }
    assert properties["impact_count", "requirement"] == "P-01"
    assert properties["impact_count", "requirement_page"] == "docs/requirements.md#p-01"
    assert ("fault", "requirement") not in properties


# --- limits -------------------------------------------------------------------------------------------------


def with_check(source, check, *settings):
    """The check as the scenario takes it, and the scenario."""
    document = {**read_scenario(source), "checks": [{"name": "fault", "equals": "drive-timeout"}, check]}
    scenario = check_scenario(apply_settings(document, settings), "mine")
    return scenario.checks[1], scenario


RIPPLE = {"name": "speed.ripple", "requirement": "P-04"}
TORQUE = {"name": "after_fault.largest_torque_n_m", "requirement": "S-05"}
DEADLINE = {"name": "after_fault.torque_zero_after_s", "requirement": "S-01"}
KICK = "a-violent-kick-stops-the-motor"


@pytest.mark.parametrize(
    ("source", "check", "settings", "limit"),
    [
        ("soft-start-multistable", RIPPLE, [], "≤ 0.002"),
        ("soft-start-multistable", RIPPLE | {"high": 0.001}, [], "≤ 0.001"),
        ("soft-start-multistable", RIPPLE | {"low": 0.0001}, [], "0.0001 … 0.002"),
        ("soft-start-multistable", RIPPLE | {"equals": 0.0}, [], "= 0.0"),
        ("soft-start-with-the-d-q-motor", RIPPLE, [], "≤ 0.005"),
        ("a-rigid-stop-keeps-the-impacts", RIPPLE, [], "≤ 0.005"),
        ("soft-start-multistable", RIPPLE, ["script.commands.0.target_ratio=0.984"], "≤ 0.003"),
        ("soft-start-multistable", RIPPLE, ["script.commands.0.target_ratio=0.987"], "≤ 0.002"),
        ("soft-start-multistable", RIPPLE, ["scene.striker.spring_n_m=68.6"], "≤ 0.005"),
        ("soft-start-multistable", RIPPLE, ["scene.striker.spring_n_m=67.9"], "≤ 0.002"),
        ("soft-start-multistable", RIPPLE, ["scene.striker.mass_kg=0.76"], "≤ 0.005"),
        ("soft-start-multistable", RIPPLE, ["scene.striker.mass_kg=0.85"], "≤ 0.002"),
        ("soft-start-multistable", RIPPLE, ["scene.drive.amplitude_m=0.0205"], "≤ 0.002"),
        (
            "soft-start-multistable",
            RIPPLE,
            ["scene.striker.spring_n_m=69.0", "scene.striker.mass_kg=0.83"],
            "≤ 0.002",
        ),
        ("a-heavier-striker-than-believed-keeps-the-impacts", RIPPLE, [], "≤ 0.005"),
        (
            "soft-start-multistable",
            RIPPLE,
            ["scene.striker.spring_n_m=68.6", "firmware.striker.spring_n_m=68.6"],
            "≤ 0.002",
        ),
        (KICK, TORQUE, [], "≤ 0.6006"),
        (KICK, TORQUE, ["firmware.speed.torque_limit_n_m=0.4"], "≤ 0.4004"),
        ("corrupted-torque-commands-stay-within-the-motor", TORQUE, [], "≤ 0.8008"),
        (KICK, DEADLINE, [], "≤ 0.5"),  # of the fault that another check demands
        (KICK, DEADLINE | {"shows_after_s": 0.25}, [], "≤ 0.75"),
        (
            "lost-operator-commands-stop-the-motor",
            DEADLINE | {"requirement": "S-08"},
            ["firmware.watchdog.operator_s=0.25"],
            "≤ 0.253",
        ),
        (KICK, {"name": "regime", "requirement": "P-01"}, [], "= impact"),
    ],
)
def test_a_check_has_the_limit_of_its_requirement_or_a_stricter_one(source, check, settings, limit):
    taken, scenario = with_check(source, check, *settings)
    assert taken.limit == limit
    assert [one.limit for one in checks_of(scenario.document)][1] == limit


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (RIPPLE | {"high": 0.1}, "permits ≤ 0.1, and its requirement P-04 only ≤ 0.002"),
        (RIPPLE | {"low": 0.003}, "permits ≥ 0.003, and its requirement P-04 only ≤ 0.002"),
        (
            RIPPLE | {"high": 0.00200000001},
            "permits ≤ 0.00200000001, and its requirement P-04 only ≤ 0.002",
        ),
        (RIPPLE | {"equals": 0.003}, "permits = 0.003"),
        ({"name": "speed.error", "requirement": "P-04", "low": -0.01}, "only -0.002 … 0.002"),
        ({"name": "regime", "requirement": "P-01", "equals": "lost"}, "permits = lost"),
        ({"name": "impact_count", "requirement": "P-14", "high": 3.0}, "only = 0"),
        ({"name": "impact_v_m_s", "requirement": "P-02"}, "P-02 has none of this figure"),
        ({"name": "impact_v_m_s"}, "has no limit, or both kinds"),
        (
            {"name": "impact_impulse_n_s", "requirement": "P-08"},
            "a multiple of target_impulse_n_s, which this",
        ),
        ({"name": "impact_count", "low": 0.0}, "no value of this figure is outside"),
        ({"name": "detector.recall", "high": 1.0}, "no value of this figure is outside"),
        ({"name": "detector.recall", "low": 0.0, "high": 1.5}, "no value of this figure is outside"),
    ],
)
def test_a_check_that_permits_more_than_its_requirement_is_refused(check, message):
    with pytest.raises(ScenarioError, match=message):
        with_check(KICK, check)


def test_a_recorded_scenario_takes_the_limits_of_another_module_anew():
    _, scenario = with_check(KICK, TORQUE)
    document = apply_settings(scenario.document, ["firmware.speed.torque_limit_n_m=0.4"])
    assert check_scenario(document, "again").checks[1].limit == "≤ 0.4004"


def test_the_speed_of_a_free_crank_falls_with_its_inertia():
    speed = {"name": "after_fault.largest_speed_rad_s", "requirement": "S-06"}
    light, heavy = (
        with_check("a-silent-encoder-stops-the-motor", speed, f"scene.motor.inertia_kg_m2={j}")[0].bounds.high
        for j in (5e-4, 1e-3)
    )
    # 25² + c (60 mm + 20 mm)² / J
    assert light == pytest.approx((25.0**2 + 70.0 * 0.08**2 / 5e-4) ** 0.5)
    assert heavy == pytest.approx((25.0**2 + 70.0 * 0.08**2 / 1e-3) ** 0.5)


def test_a_stricter_limit_is_said_to_be_the_scenarios_own():
    taken, _ = with_check(KICK, TORQUE | {"high": 0.2})
    result = replace(CHECKS[1], name=taken.name, unit="N m", limit=taken.limit, requirement="S-05")
    own = replace(result, required=taken.required.text)
    assert own.sentence.endswith("(the scenario's own limit, for its module; S-05 requires ≤ 0.6006 N m)")


@pytest.mark.parametrize(
    ("check", "value", "met"),
    [
        (TORQUE | {"high": 0.2}, 0.3, True),
        (TORQUE | {"high": 0.2}, 0.7, False),
        (TORQUE | {"high": 0.2}, None, False),
        (TORQUE, 0.7, False),
        ({"name": "after_fault.largest_torque_n_m", "requirement": "S-11", "high": 0.2}, 0.3, None),
        ({"name": "after_fault.largest_torque_n_m", "high": 0.2}, 0.3, None),
    ],
)
def test_a_value_beyond_a_stricter_limit_meets_its_requirement(check, value, met):
    taken, _ = with_check(KICK, check)
    assert meets_requirement(taken, value) is met


@pytest.mark.parametrize("key", [key for key in RANGES if key.removeprefix("scene.") in DESCRIBED])
def test_p_04_permits_more_of_ripple_wherever_a_search_looks_for_modules(key):
    name = "dry-friction-keeps-the-impacts" if key == "scene.friction.mu" else "soft-start-multistable"
    value = attrgetter(key.removeprefix("scene."))(load_scenario(name).scene)
    for end in RANGES[key](value):
        assert with_check(name, RIPPLE, f"{key}={end!r}")[0].limit == "≤ 0.005"


@pytest.mark.parametrize(
    ("scenario", "settings", "high"),
    [
        ("a-rigid-stop-keeps-the-impacts", [], 0.005),
        ("a-rigid-stop-keeps-the-impacts", ["scene.stop.restitution=0.52"], 0.009),
        ("soft-start-with-the-d-q-motor", [], 0.005),
        ("soft-start-with-the-d-q-motor", ["scene.stop.restitution=0.52"], 0.006),
    ],
)
def test_the_ripple_of_a_special_module_that_differs_has_a_limit_of_its_own(scenario, settings, high):
    [ripple] = [one for one in load_scenario(scenario, settings).checks if one.name == "speed.ripple"]
    assert ripple.required is not None
    assert ripple.required.high == high


def test_every_limit_names_a_figure_a_quantity_and_conditions_that_exist():
    scenario = load_scenario("an-impulse-asked-for-is-held")
    keys = {"kind", "frames", "nearly_described", "whole_counts"} | set(CATALOGUE)
    for name, requirement in requirements().items():
        for limit in requirement.limits:
            assert limit.figure in CATALOGUE, name
            assert Check(name=limit.figure, **limit.model_dump(include={"low", "high", "equals"})), name
            assert limit.when.keys() - keys == {
                key for key in limit.when if key.startswith(("scene.", "firmware."))
            }
            if limit.of is not None and limit.of not in SCALES:
                assert look_up(scenario, limit.of) > 0.0, f"{name}: {limit.of}"


def test_the_deadlines_of_faults_are_those_of_the_fault_table():
    table = (ROOT / "docs" / "safety.md").read_text("utf-8")
    rows = re.findall(r"^\| \d+ \| ([A-Z_]+) \| .* \| ([\d.]+) s \|$", table, re.MULTILINE)
    deadline_s = {name.lower().replace("_", "-"): float(seconds) for name, seconds in rows}
    default, *longer = requirements()["S-01"].limits_of("after_fault.torque_zero_after_s")
    assert default.high == min(deadline_s.values())
    for limit in (one for one in longer if "fault" in one.when):
        assert limit.high == deadline_s[limit.when["fault"]], limit.when


@pytest.mark.parametrize(
    ("name", "frames", "high"),
    [
        ("silent-gait-sensors-stop-the-motor", '["GaitSensors"]', 0.25),
        ("silent-gait-sensors-stop-the-motor", '["Accelerometer", "GaitSensors"]', 0.1),
        ("a-silent-encoder-stops-the-motor", '["EncoderEstimates"]', 0.1),
    ],
)
def test_only_the_gaits_sensors_alone_may_be_silent_for_longer(name, frames, high):
    checks = load_scenario(name, [f"script.faults.0.frames={frames}"]).checks
    [ends] = [one for one in checks if one.name == "after_fault.torque_zero_after_s"]
    assert ends.required is not None
    assert ends.required.high == high
