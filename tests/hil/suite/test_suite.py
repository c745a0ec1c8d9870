"""A suite: which scenarios run, what it leaves behind, and what one that breaks off does to it."""

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from resting import resting

from hil.faults.every import KINDS
from hil.judge.evaluation import is_within
from hil.judge.judge import judge
from hil.judge.seeds import merge
from hil.judge.verdict import CheckResult, RunVerdict, Verdict
from hil.processes.workers import Died
from hil.record.run_folder import RunFolderError
from hil.record.run_traces import RunTraces
from hil.runs.job import RunOptions, silent
from hil.scenario.checks import Check
from hil.scenario.files import scenario_names
from hil.scenario.scenario import load_scenario
from hil.scenario.seeds import delay_faults
from hil.suite.compare_suites import SuiteError, compare, read_suite
from hil.suite.suite import Case, Chosen, run_suite, scenarios_for
from tools.cli import run
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_NOTHING_RAN, EXIT_PASSED

LOCKSTEP = RunOptions(clock="lockstep")

MODELLED = "a-bus-off-of-ten-ticks-is-ridden-through"


def test_all_scenarios_load_and_are_named_as_their_files() -> None:
    scenarios, left_out = scenarios_for([], "lockstep")
    assert [one.name for one in scenarios] == scenario_names()
    assert len(scenarios) >= 40
    assert left_out == []
    assert all(one.checks and one.commands and one.title[0].isupper() for one in scenarios)


def test_every_kind_of_fault_has_a_scenario_that_bounds_what_follows() -> None:
    scenarios, _ = scenarios_for([], "lockstep")
    kinds = {type(fault) for one in scenarios for fault in one.faults}
    assert kinds == set(KINDS)
    for one in scenarios:
        if one.faults:
            bounded = {check.name for check in one.checks}
            physical = {"after_fault.largest_torque_n_m", "safe_state.command_zero_after_s"}
            assert bounded & physical, one.name


def test_a_modelled_bus_is_left_out_in_real_time(capsys: pytest.CaptureFixture[str]) -> None:
    scenarios, left_out = scenarios_for([MODELLED, "operator-lost"], "real")
    assert ([one.name for one in scenarios], left_out) == (["operator-lost"], [MODELLED])
    assert run(["suite", MODELLED, "--clock", "real", "--json"]) == EXIT_NOTHING_RAN
    assert json.loads(capsys.readouterr().out)["verdict"] == "not-judged"
    assert run(["suite", "no-such-scenario", "--json"]) == EXIT_BAD_INPUT


@pytest.mark.usefixtures("in_process")
def test_a_suite_leaves_one_page_one_xml_and_a_folder_a_run(tmp_path: Path) -> None:
    names = [str(resting(tmp_path)), str(resting(tmp_path, "impacts", fewest=1.0))]
    result = run_suite(Chosen(names), LOCKSTEP, tmp_path / "out", [1], silent)
    assert [(one["name"], one["passed"]) for one in result["scenarios"]] == [
        ("rests", True),
        ("impacts", False),
    ]
    assert result["passed"] is False
    assert result["scenarios"][1]["failed"][0]["value"] == 0
    xml = ElementTree.parse(result["junit"]).getroot()
    assert [(one.get("name"), one.get("failures")) for one in xml] == [("rests", "0"), ("impacts", "1")]
    assert "1 of 2 scenarios passed" in Path(result["report"]).read_text()
    assert (tmp_path / "out" / "rests" / "run.rrd").exists()


@pytest.mark.usefixtures("in_process")
def test_a_suite_says_what_was_changed_in_it_and_what_its_failures_mean(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heavy = tmp_path / "heavy.toml"
    heavy.write_text('format = 1\n[parameters."speed.gain_p_n_m_s"]\nvalue = 0.05\nunit = "N m s"\n')
    inertia = "scene.motor.inertia_kg_m2=0.001"
    command = ["suite", str(resting(tmp_path, "impacts", fewest=1.0)), "--out", str(tmp_path / "out")]
    status = run([*command, "--set", inertia, "--parameters", str(heavy)])
    printed = capsys.readouterr().out
    assert status == EXIT_CHECK_FAILED
    page = (tmp_path / "out" / "index.html").read_text()
    for text in (printed, page):
        assert inertia in text
        assert str(heavy) in text
        assert "failed: 1 missed only own limits; none broke a requirement" in text
    note = json.loads((tmp_path / "out" / "suite.json").read_text())
    assert note["failures"]["own_limits"] == ["impacts"]


def test_a_killed_worker_costs_only_its_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def results(judge: Any, cases: Sequence[Case], _: int) -> Iterator[tuple[Case, Any]]:
        for case in cases:
            yield case, Died("was killed by SIGKILL") if case.scenario.name == "long" else judge(case)

    monkeypatch.setattr("hil.processes.workers.results", results)
    names = [str(resting(tmp_path, name)) for name in ("long", "quick")]
    long, quick = run_suite(Chosen(names), LOCKSTEP, tmp_path / "out", [1], silent)["scenarios"]
    assert (long["passed"], quick["passed"]) == (False, True)
    assert "its process was killed by SIGKILL" in long["reasons"][0]


def test_a_suite_on_a_bus_that_does_not_open_is_refused_with_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["suite", str(resting(tmp_path)), "--clock", "real", "--bus", "no-bus", "--out", str(out)]
    assert run(command) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.startswith("error: bus 'no-bus' is not known")
    assert not out.exists(), "nothing ran, so nothing remains that names a kill as the reason"


def noisy(folder: Path, highest_m_s: float) -> str:
    """A scenario that depends on its seed: one fault in ten thousand ticks would be too few."""
    path = folder / "noisy.toml"
    path.write_text(
        'title = "It rests"\nscene = "table1-motor-soft"\n[script]\nduration_s = 0.3\n'
        '[[script.faults]]\nkind = "parameters-damaged"\nat_s = 0.0\n'
        f'[[checks]]\nname = "impact_count"\nhigh = {highest_m_s}\n'
        '[[checks]]\nname = "fault"\nequals = "parameters-damaged"\n'
    )
    return str(path)


@pytest.mark.usefixtures("in_process")
def test_a_scenario_in_many_seeds_has_one_verdict_and_leaves_little(tmp_path: Path) -> None:
    result = run_suite(Chosen([noisy(tmp_path, 0.0)]), LOCKSTEP, tmp_path / "out", range(3, 6), silent)
    (one,) = result["scenarios"]
    assert (one["passed"], one["seeds"], one["passed_seeds"], one["failed_seeds"]) == (True, 3, 3, [])
    assert [check["passed_seeds"] for check in one["checks"]] == [3, 3]
    assert result["seeds"] == [3, 4, 5]
    left = sorted(path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.*"))
    assert left == [
        "index.html",
        "junit.xml",
        *(
            f"noisy/seed-{seed}/{name}"
            for seed in (3, 4, 5)
            for name in ("run.json", "scenario.toml", "verdict.json")
        ),
        "suite.json",
    ]
    assert "3 of 3 seeds" in Path(result["report"]).read_text()


@pytest.mark.usefixtures("in_process")
def test_a_seed_that_fails_keeps_its_log(tmp_path: Path) -> None:
    result = run_suite(Chosen([noisy(tmp_path, -1.0)]), LOCKSTEP, tmp_path / "out", [1, 2], silent)
    assert result["scenarios"][0]["failed_seeds"] == [1, 2]
    assert (tmp_path / "out" / "noisy" / "seed-2" / "run.rrd").exists()
    xml = ElementTree.parse(result["junit"]).getroot()
    properties = {one.get("name"): one.get("value") for one in xml.iter("property")}
    assert properties["passed_seeds"] == "2"


def test_a_seed_moves_the_fault_and_what_follows_it_within_a_drive_period() -> None:
    written = load_scenario("a-restarted-controller-goes-on-once-it-is-asked-anew")
    assert delay_faults(written, 1) is written
    times_s = set()
    for seed in range(2, 40):
        moved = delay_faults(written, seed)
        by_s = moved.faults[0].at_s - written.faults[0].at_s
        assert 0.0 < by_s < 0.611
        assert moved.duration_s - written.duration_s == pytest.approx(by_s)
        later = [one.at_s - other.at_s for one, other in zip(moved.commands, written.commands, strict=True)]
        assert later == pytest.approx([0.0, by_s, by_s, by_s])
        assert moved.faults[0].duration_s == written.faults[0].duration_s
        times_s.add(by_s)
    assert len(times_s) > 30
    from_the_start = load_scenario("damaged-parameters-arm-nothing")
    assert delay_faults(from_the_start, 7) is from_the_start
    assert delay_faults(load_scenario("operator-lost"), 7).faults == ()


def test_a_seed_moves_a_stop_that_may_come_in_every_stage() -> None:
    written = load_scenario("an-e-stop-in-the-start-ends-the-torque")
    times_s = [delay_faults(written, seed).commands[-1].at_s for seed in range(2, 40)]
    assert min(times_s) < 4.0
    assert max(times_s) > 11.0
    operator = load_scenario("e-stop-in-the-hold")  # it states no longest delay
    assert delay_faults(operator, 7) is operator


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    "scenario",
    [
        "a-violent-kick-stops-the-motor",
        "a-violent-kick-into-a-weak-stop-stops-the-motor",
        "a-violent-kick-just-before-an-impact-stops-the-motor",
        "a-winding-found-hot-right-after-run-moves-nothing",
        "a-drive-that-falls-silent-right-after-run-is-disarmed",
    ],
)
def test_a_fault_at_certain_phases_alone_is_judged_alike_with_every_seed(
    scenario: str, tmp_path: Path
) -> None:
    result = run_suite(Chosen([scenario]), LOCKSTEP, tmp_path / "out", [2, 7, 8], silent)
    assert result["scenarios"][0]["failed_seeds"] == []


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("scenario", "seeds"),
    [
        # The accelerometer turns round just before an impact, and far from one.
        ("an-accelerometer-the-wrong-way-round-does-no-harm", [5, 13]),
        # A touch-down far from the stop; several of them.
        ("a-noisy-accelerometer-does-no-harm", [5, 27]),
        # All readings of a contact are lost.
        ("half-of-the-samples-lost-is-ridden-through", [5, 9]),
        ("a-fifth-more-strides-keep-the-impacts", [5, 10]),
    ],
)
def test_a_fault_that_does_no_harm_does_none_with_any_seed(
    scenario: str, seeds: list[int], tmp_path: Path
) -> None:
    result = run_suite(Chosen([scenario]), LOCKSTEP, tmp_path / "out", seeds, silent)
    assert [one["seeds"] for one in result["scenarios"]] == [len(seeds)]
    assert [one["passed"] for one in result["scenarios"]] == [True]


@pytest.mark.parametrize("longest_s", [0.0, 0.0015, 0.02])
def test_a_script_limits_the_delay_of_its_faults(longest_s: float) -> None:
    written = load_scenario("a-stuck-encoder-stops-the-motor", {"script.longest_delay_s": longest_s})
    moved = {delay_faults(written, seed).faults[0].at_s for seed in range(2, 40)}
    by_s = {at_s - written.faults[0].at_s for at_s in moved}
    assert len(by_s) == 1 if longest_s < 0.002 else len(by_s) > 10
    assert max(by_s) < max(longest_s, 1e-9)


@pytest.mark.parametrize("duration_s", [86_000.0, 86_399.9, 86_400.0])
def test_no_delay_makes_a_run_longer_than_a_day(duration_s: float) -> None:
    longest = {"script.duration_s": duration_s, "script.longest_delay_s": 86_400.0}
    written = load_scenario("a-stuck-encoder-stops-the-motor", longest)
    lasts_s = {delay_faults(written, seed).duration_s for seed in range(2, 40)}
    assert max(lasts_s) <= 86_400.0
    assert (len(lasts_s) > 10) is (duration_s < 86_400.0)


CHECKS = [
    Check(name="peak_force_n", low=90.0, high=180.0, unit="N"),
    Check(name="regime", equals="impact"),
]


def verdict(force_n: float | None, regime: str) -> RunVerdict:
    values = {"peak_force_n": force_n, "regime": regime}
    results = tuple(
        CheckResult(one.name, Verdict.PASSED if met else Verdict.FAILED, values[one.name], "", one.limit)
        for one in CHECKS
        for met in [is_within(one, values[one.name])]
    )
    reasons = ("firmware left no trace",) if regime == "none" else ()
    return replace(judge(RunTraces(), Path()), checks=results, reasons=reasons)


def test_the_worst_figure_is_the_one_nearest_to_or_furthest_beyond_a_limit() -> None:
    good = merge(
        CHECKS, {1: verdict(120.0, "impact"), 2: verdict(178.0, "impact"), 3: verdict(93.0, "impact")}
    )
    force, regime = good.checks
    assert (good.passed, force.value, force.seed, force.lowest, force.highest) == (
        True,
        178.0,
        2,
        93.0,
        178.0,
    )
    assert (regime.lowest, regime.highest) == (None, None)
    bad = merge(CHECKS, {1: verdict(120.0, "lost"), 2: verdict(190.0, "impact"), 3: verdict(None, "none")})
    assert (bad.passed, bad.passed_seeds, bad.failed_seeds) == (False, 0, (1, 2, 3))
    assert [(one.value, one.seed, one.passed_seeds) for one in bad.checks] == [(None, 3, 1), ("lost", 1, 1)]
    assert bad.reasons == ("seed 3: firmware left no trace",)


@pytest.mark.usefixtures("in_process")
def test_two_suites_differ_where_a_verdict_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rests, impacts = str(resting(tmp_path)), str(resting(tmp_path, "impacts", fewest=1.0))
    for name, names in (("a", [rests, impacts]), ("b", [rests]), ("c", [impacts])):
        run_suite(Chosen(names), LOCKSTEP, tmp_path / name, [1], silent)
    a, b, c = (str(tmp_path / name) for name in "abc")
    assert run(["compare", a, a, "--must-be-equal"]) == EXIT_PASSED
    capsys.readouterr()
    assert run(["compare", a, b, "--must-be-equal", "--json"]) == EXIT_CHECK_FAILED
    result = json.loads(capsys.readouterr().out)
    assert (result["compared"], result["only_in_a"], result["equal"]) == (["rests"], ["impacts"], False)
    assert run(["compare", b, c, "--json"]) == EXIT_NOTHING_RAN
    changed = read_suite(tmp_path / "a")
    changed["scenarios"][1]["passed"] = changed["scenarios"][1]["checks"][0]["passed"] = True
    found = compare(read_suite(tmp_path / "a"), changed)
    assert found["verdicts"] == [{"scenario": "impacts", "a": False, "b": True}]
    assert [(one["scenario"], one["figure"]) for one in found["changes"] if one["flipped"]] == [
        ("impacts", "impact_count")
    ]
    changed["scenarios"][1]["checks"][0]["limit"] = "≥ 2"
    found = compare(read_suite(tmp_path / "a"), changed)
    assert (found["only_in_a"], found["only_in_b"]) == (
        ["impacts: impact_count 1 … 9"],
        ["impacts: impact_count ≥ 2"],
    )
    (tmp_path / "c" / "suite.json").write_text(json.dumps(changed))
    capsys.readouterr()
    assert run(["compare", a, c]) == EXIT_PASSED
    assert run(["compare", a, c, "--must-be-equal"]) == EXIT_CHECK_FAILED
    assert "1 of 2 scenarios" in capsys.readouterr().out
    assert run(["compare", a, str(tmp_path)]) == EXIT_BAD_INPUT


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(("seeds", "settings"), [([1, 2], []), ([2], []), ([1], ["script.duration_s=0.4"])])
def test_suites_of_other_seeds_or_figures_are_not_equal(
    tmp_path: Path, seeds: list[int], settings: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    rests = tmp_path / "rests.toml"
    rests.write_text(resting(tmp_path).read_text().replace("impact_count", "duration_s"))
    for name, own_seeds, own in (("a", [1], []), ("b", seeds, settings)):
        run_suite(Chosen([str(rests)], own), LOCKSTEP, tmp_path / name, own_seeds, silent)
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    for command in (["compare", a, b], ["compare", b, a], ["compare", a, b, "--tolerance", "*=0"]):
        assert run([*command, "--must-be-equal", "--json"]) == EXIT_CHECK_FAILED
        assert json.loads(capsys.readouterr().out)["equal"] is False
    assert run(["compare", a, b]) == EXIT_PASSED
    shown = capsys.readouterr().out
    assert ("seeds only in a, not compared: 1\n" in shown) == (1 not in seeds)
    assert ("seeds only in b, not compared: 2\n" in shown) == (2 in seeds)


@pytest.mark.usefixtures("in_process")
def test_a_foreign_suite_folder_with_links_changes_nothing_outside(tmp_path: Path) -> None:
    victim, foreign, name = tmp_path / "victim", tmp_path / "out", "resting"
    other = victim / "run"
    other.mkdir(parents=True)
    for one in (victim / "page.html", other / "scenario.toml"):
        one.write_text("precious\n")
    (other / "run.json").write_text('{"made_by": "vibrohil"}')
    foreign.mkdir()
    (foreign / "suite.json").write_text('{"made_by": "vibrohil"}')
    for page in ("junit.xml", "index.html"):
        (foreign / page).symlink_to(victim / "page.html")
    scenario = resting(tmp_path, name)
    run_suite(Chosen([str(scenario)]), LOCKSTEP, foreign, [1], silent)
    shutil.rmtree(foreign / name)
    (foreign / name).symlink_to(other)
    with pytest.raises(RunFolderError, match="is a link to"):
        run_suite(Chosen([str(scenario)]), LOCKSTEP, foreign, [1], silent)
    assert (victim / "page.html").read_text() == "precious\n"
    assert (other / "scenario.toml").read_text() == "precious\n"


@pytest.mark.parametrize("name", ["..", "."])
def test_a_scenario_named_by_dots_has_no_folder_and_removes_nothing_above_the_suite(
    tmp_path: Path, name: str
) -> None:
    scenario = tmp_path / f"{name}.toml"
    scenario.write_text('title = "x"\nscene = "table1-motor-soft"\n[script]\nduration_s = 0.1\n')
    above = tmp_path / "run"
    above.mkdir()
    (above / "run.json").write_text('{"made_by": "vibrohil"}')
    (above / "can.log").write_text("precious\n")
    assert (
        run(["suite", str(scenario), "--out", str(above / "suite"), "--clock", "lockstep"]) == EXIT_BAD_INPUT
    )
    assert sorted(one.name for one in above.iterdir()) == ["can.log", "run.json"]


def scenario_with(**changed: object) -> dict[str, object]:
    check = {
        "name": "x",
        "limit": "≤ 1",
        "unit": "",
        "passed": True,
        "value": 0.5,
        "values": [0.5],
        "margins": [0.5],
    }
    scenario = {"name": "one", "passed": True, "checks": [check | changed]}
    return {"format": 1, "clock": "lockstep", "seeds": [1], "scenarios": [scenario]}


ILL_TYPED = {
    "values that are a text": scenario_with(values="x", margins="y"),
    "values for no seed": scenario_with(values=[], margins=[]),
    "a limit that is a table": scenario_with(limit={"a": 1}),
    "a clock that is a table": scenario_with() | {"clock": {"a": 1}},
    "seeds that are lists": scenario_with() | {"seeds": [[1]]},
    "a name that is a number": scenario_with() | {"scenarios": [{"name": 5, "passed": True, "checks": []}]},
    "a verdict that is a text": scenario_with()
    | {"scenarios": [{"name": "one", "passed": "x", "checks": []}]},
    "no seeds": {"format": 1, "clock": "lockstep", "scenarios": []},
    "scenarios that are a text": scenario_with() | {"scenarios": "x"},
    "a list": [],
}


@pytest.mark.parametrize("content", ILL_TYPED.values(), ids=ILL_TYPED)
def test_a_suite_of_other_types_is_refused_or_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: object
) -> None:
    for name, written in (("good", scenario_with()), ("foreign", content)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "suite.json").write_text(json.dumps(written))
    assert run(["compare", str(tmp_path / "good"), str(tmp_path / "good")]) == EXIT_PASSED
    status = run(["compare", str(tmp_path / "good"), str(tmp_path / "foreign")])
    assert status in (EXIT_PASSED, EXIT_BAD_INPUT), capsys.readouterr().err


def test_a_suite_that_is_a_link_or_too_large_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "suite.json").symlink_to("/etc/passwd")
    with pytest.raises(SuiteError, match="wanted the folder of"):
        read_suite(tmp_path)
    (tmp_path / "suite.json").unlink()
    with (tmp_path / "suite.json").open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(RunFolderError, match="wanted 33554432 at most"):
        read_suite(tmp_path)


@pytest.mark.usefixtures("in_process")
def test_a_foreign_suite_folder_with_pipes_is_refused(tmp_path: Path) -> None:
    scenario = resting(tmp_path, "resting")
    run_suite(Chosen([str(scenario)]), LOCKSTEP, tmp_path / "out", [1], silent)
    note = json.loads((tmp_path / "out" / "suite.json").read_text())
    (tmp_path / "out" / "suite.json").write_text(json.dumps(note | {"complete": False}))
    verdict = tmp_path / "out" / "resting" / "verdict.json"
    verdict.unlink()
    os.mkfifo(verdict)
    with pytest.raises(RunFolderError, match="no file but a link, folder, pipe or device"):
        run_suite(Chosen([str(scenario)]), LOCKSTEP, tmp_path / "out", [1], silent)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("damage", [b'{"reasons": [', b"[" * 100_000, b'{"reasons": [1], "checks": {}}'])
def test_a_damaged_verdict_is_judged_again(damage: bytes, tmp_path: Path) -> None:
    scenario, folder = resting(tmp_path, "resting"), tmp_path / "out"
    run_suite(Chosen([str(scenario)]), LOCKSTEP, folder, [1], silent)
    note = json.loads((folder / "suite.json").read_text())
    (folder / "suite.json").write_text(json.dumps(note | {"complete": False}))
    verdict = folder / "resting" / "verdict.json"
    before = json.loads(verdict.read_text())
    verdict.write_bytes(damage)
    run_suite(Chosen([str(scenario)]), LOCKSTEP, folder, [1], silent)
    assert json.loads(verdict.read_text())["checks"] == before["checks"]
