"""Passed, failed or not judged: one answer in terminal, JSON, JUnit, pages and exit status."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
import tomli_w
from resting import resting
from run_folder import make_run, write_run

from hil.judge.seeds import merge
from hil.judge.verdict import Verdict, trace, worst
from hil.judge.verdict_files import junit_document
from hil.runs.job import RunOptions, silent
from hil.runs.verdict import finish
from hil.scenario.checks import checks_of
from hil.show.report.pages import write_suite_report
from hil.suite.suite import Chosen, run_suite
from tools.cli import run
from tools.output import EXIT_CHECK_FAILED, EXIT_NOTHING_RAN, EXIT_PASSED, exit_of

NOT_REACHED = "the firmware never reached mode RUN, so the run has no hold"


def unchecked(folder: Path) -> str:
    """The file of a scenario without a check."""
    path = folder / "unchecked.toml"
    path.write_text('title = "It rests"\nscene = "table1-motor-soft"\n[script]\nduration_s = 0.3\n')
    return str(path)


def test_a_failure_outweighs_a_doubt_and_a_doubt_a_pass():
    passed, failed, doubted = Verdict.PASSED, Verdict.FAILED, Verdict.NOT_JUDGED
    assert worst([passed, doubted, failed]) is failed
    assert worst([passed, doubted]) is doubted
    assert worst([passed, passed]) is passed
    assert [one.passed for one in (passed, failed, doubted)] == [True, False, None]


def test_a_scenario_without_checks_is_not_judged_by_a_run(tmp_path, capsys):
    assert (
        run(["run", unchecked(tmp_path), "--clock", "lockstep", "--out", str(tmp_path / "a"), "--json"]) == 5
    )
    verdict = json.loads(capsys.readouterr().out)
    assert (verdict["verdict"], verdict["passed"]) == ("not-judged", None)
    assert verdict["not_judged"] == ["nothing was checked; give the scenario a table [[checks]]"]
    (case,) = ElementTree.parse(tmp_path / "a" / "junit.xml").getroot()[0].iter("testcase")
    assert case.find("error").get("message").startswith("not judged: nothing was checked")
    assert "NOT JUDGED" in (tmp_path / "a" / "report.html").read_text()
    assert run(["inspect", str(tmp_path / "a")]) == EXIT_NOTHING_RAN
    assert "NOT JUDGED" in capsys.readouterr().out


@pytest.mark.parametrize("seeds", [1, 2])
@pytest.mark.usefixtures("in_process")
def test_a_scenario_without_checks_is_not_judged_by_a_suite(tmp_path, capsys, seeds):
    names = [unchecked(tmp_path), str(resting(tmp_path))]
    out = tmp_path / "out"
    assert run(["suite", *names, "--out", str(out), "--seeds", str(seeds)]) == EXIT_NOTHING_RAN
    text = capsys.readouterr().out
    assert "1 of 2 passed" in text
    assert "1 not judged" in text
    assert "not judged: nothing was checked" in text
    result = json.loads((out / "suite.json").read_text())
    assert [one["verdict"] for one in result["scenarios"]] == ["not-judged", "passed"]
    assert (result["verdict"], result["passed"]) == ("not-judged", None)
    counts = [
        (one.get("failures"), one.get("errors")) for one in ElementTree.parse(out / "junit.xml").getroot()
    ]
    assert counts == [("0", "1"), ("0", "0")]
    page = (out / "index.html").read_text()
    assert "1 of 2 scenarios passed" in page
    assert "NOT JUDGED" in page


@pytest.mark.usefixtures("in_process")
def test_a_failed_check_gives_status_1_beside_a_run_that_is_not_judged(tmp_path):
    names = [unchecked(tmp_path), str(resting(tmp_path, "impacts", fewest=1.0))]
    result = run_suite(Chosen(names), RunOptions(clock="lockstep"), tmp_path / "out", [1], silent)
    assert exit_of(result) == EXIT_CHECK_FAILED
    assert exit_of({"passed": True}) == EXIT_PASSED


def test_a_run_that_the_bench_could_not_judge_says_why_everywhere(tmp_path):
    made_up = make_run()
    made_up.outcome["not_judged"] = ["the plant was held up for 40 ms at 2.00 s"]
    verdict = finish(write_run(made_up, tmp_path / "run"))
    assert (verdict.verdict, verdict.passed) == (Verdict.NOT_JUDGED, None)
    assert all(check.passed for check in verdict.checks)
    error = ElementTree.parse(tmp_path / "run" / "junit.xml").getroot().find("testsuite/testcase/error")
    assert error.get("message") == "not judged: the plant was held up for 40 ms at 2.00 s"
    assert "the plant was held up for 40 ms" in (tmp_path / "run" / "report.html").read_text()
    of_requirements = trace([verdict])
    assert {one["verdict"] for one in of_requirements.values()} <= {"not-judged", None}
    both = merge(checks_of(made_up.scenario), {1: verdict})
    write_suite_report(tmp_path / "index.html", [both], of_requirements)
    assert "not judged: the plant was held up for 40 ms" in (tmp_path / "index.html").read_text()


def test_a_run_whose_firmware_the_host_stopped_before_its_first_tick_is_not_judged(tmp_path):
    made_up = make_run()
    made_up.run |= {"clock": "real", "time": "held"}
    made_up.firmware = {name: values[:0] for name, values in made_up.firmware.items()}
    held_up = "the host held up the firmware for more than 10 s at 0.00 s"
    made_up.outcome |= {"cut_s": 0.0, "cut_by": "firmware", "not_judged": [held_up]}
    verdict = finish(write_run(made_up, tmp_path / "run"))
    assert (verdict.verdict, verdict.reasons, verdict.doubts) == (Verdict.NOT_JUDGED, (), (held_up,))
    assert not any(check.verdict is Verdict.FAILED for check in verdict.checks)


def test_one_seed_that_is_not_judged_leaves_the_scenario_not_judged(tmp_path):
    made_up = make_run()
    checks = [{"name": "regime", "equals": "impact"}]
    made_up.scenario["checks"] = checks
    fine = finish(write_run(made_up, tmp_path / "a"))
    made_up.outcome["not_judged"] = ["a hold of 11 s"]
    doubted = finish(write_run(made_up, tmp_path / "b"))
    both = merge(checks_of({"checks": checks}), {1: fine, 2: doubted})
    assert (both.verdict, both.passed_seeds, both.not_judged_seeds) == (Verdict.NOT_JUDGED, 1, (2,))
    assert both.not_judged == ("seed 2: a hold of 11 s",)
    assert "not judged: seed 2: a hold of 11 s" in junit_document([both])


OWN = {"name": "mean_torque", "expression": "mean(firmware.outputs.torque_n_m)", "low": 0.0, "unit": "N m"}


WITHOUT_FIGURES = [
    ({"name": "capture_s", "high": 10.0}, NOT_REACHED),
    ({"name": "estimate.x_rmse_m", "high": 1.0}, NOT_REACHED),
    ({"name": "regime", "equals": "impact"}, NOT_REACHED),
    ({**OWN, "from_s": 50.0, "to_s": 60.0}, "nothing was recorded from 50 s to 60 s: the run lasted"),
    ({**OWN, "expression": "max(plant.x_m)", "to_s": 60.0}, "before the window's end, 60 s"),
    ({**OWN, "expression": "max(plant.x_m / 0.0)"}, "'max(plant.x_m / 0.0)' gives inf"),
]


def test_a_check_without_its_figure_says_why(tmp_path, capsys):
    path, out = resting(tmp_path), tmp_path / "run"
    rests = path.read_text().partition("[[checks]]")[0]
    path.write_text(rests + tomli_w.dumps({"checks": [check for check, _ in WITHOUT_FIGURES]}))
    assert run(["run", str(path), "--clock", "lockstep", "--out", str(out)]) == EXIT_CHECK_FAILED
    terminal = " ".join(capsys.readouterr().out.split())
    texts = [terminal, (out / "junit.xml").read_text(), (out / "report.html").read_text()]
    checks = json.loads((out / "verdict.json").read_text())["checks"]
    for check, (_, reason) in zip(checks, WITHOUT_FIGURES, strict=True):
        assert reason in check["reason"]
        assert all(reason in text.replace("&#39;", "'") for text in texts)
