"""A finished run folder: verdict, JUnit and report, also of a run that went wrong."""

import html
import html.parser
import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from run_folder import make_run, write_run

from firmware_py.interface.enums import Fault
from hil.judge.seeds import merge
from hil.judge.verdict import failed_for, trace
from hil.judge.verdict_files import junit_document, read_verdict
from hil.record.rrd.rerun_program import rerun
from hil.record.run_faults import RunFault
from hil.runs.recorded_run import open_run
from hil.runs.verdict import finish
from hil.scenario.checks import checks_of, requirements
from hil.show.report.pages import write_suite_report
from tools import cli
from tools.commands.run import show_checks, show_figures

# What a program that reads the verdict may rely on.
KEYS = {
    *("scenario", "clock", "bus", "kernel_can", "real_time", "duration_s", "ticks", "overruns"),
    *("baseline_overruns", "tick_us", "bus_load", "realtime_factor", "impacts", "regime", "peak_force_n"),
    *("estimate", "detector", "checks", "passed", "out"),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    run_dir = write_run(make_run(), tmp_path_factory.mktemp("run"))
    return run_dir, finish(run_dir)


def in_a_suite(verdict):
    """The verdict on the scenario of one run."""
    return merge(checks_of(make_run().scenario), {1: verdict})


class Page(html.parser.HTMLParser):
    """What a page refers to and says, and whether its tags close."""

    VOID = frozenset({"meta", "br", "link", "img", "input", "hr"})

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        names = {"src", "href", "xlink:href"}
        self.references += [value for name, value in attrs if name in names and not value.startswith("#")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_the_verdict_has_every_key_and_is_what_is_written(finished):
    run_dir, judged = finished
    verdict = judged.as_json()
    assert set(verdict) >= KEYS
    assert verdict["passed"]
    assert verdict["out"] == str(run_dir)
    written = json.loads((run_dir / "verdict.json").read_text())
    assert written == {**json.loads(json.dumps(verdict)), "out": run_dir.name}
    assert read_verdict(run_dir / "verdict.json").as_json() == verdict
    assert verdict["checks"][0] == {
        "name": "regime",
        "passed": True,
        "verdict": "passed",
        "value": "impact",
        "unit": "",
        "limit": "= impact",
        "requirement": None,
        "reason": None,
        "margin_share": None,
        "required": None,
        "meets_requirement": None,
    }
    assert {"t_s", "v_m_s"} == set(verdict["impacts"][0])


def test_the_log_of_a_finished_run_is_whole(finished):
    run_dir, _ = finished
    assert rerun(["rrd", "verify", run_dir / "run.rrd"]).returncode == 0


def test_finishing_again_changes_nothing(finished, tmp_path):
    run_dir, verdict = finished
    assert finish(run_dir) == verdict


def test_a_failed_check_fails_the_run_and_junit_says_what_was_measured(tmp_path):
    made_up = make_run()
    made_up.scenario["checks"] = [
        {"name": "peak_force_n", "high": 100.0, "unit": "N"},
        {"name": "regime", "equals": "impact"},
    ]
    verdict = finish(write_run(made_up, tmp_path)).as_json()
    assert not verdict["passed"]

    suite = ElementTree.parse(tmp_path / "junit.xml").getroot()[0]
    assert (suite.get("name"), suite.get("tests"), suite.get("failures")) == ("made-up", "3", "1")
    failure = suite.find("testcase/failure")
    assert failure.get("message") == "peak_force_n is 250 N, wanted ≤ 100 N"
    case = suite.find("testcase[@name='peak_force_n']")
    assert {item.get("name"): item.get("value") for item in case.iter("property")} == {
        "value": "250.0",
        "unit": "N",
        "limit": "≤ 100",
    }


@pytest.mark.parametrize("frames", [0, 800])
def test_losses_of_the_recorder_are_reported_and_no_check_is_judged_on_them(tmp_path, frames, capsys):
    made_up = make_run()
    made_up.scenario["checks"] = [{"name": "bus_load", "low": 0.01}, {"name": "regime", "equals": "impact"}]
    made_up.run["nodes"] = {"recorder": {"frames": 5000, "lost": frames}}
    finished = finish(write_run(made_up, tmp_path))
    show_figures(finished.figures)
    show_checks(finished)
    printed = capsys.readouterr().out
    assert ("bus load, lost frames left out" in printed) is bool(frames)
    assert ("can.log lacks 800 frames; incomplete: bus_load" in printed) is bool(frames)
    verdict = finished.as_json()
    # The other nodes of this folder have reported nothing.
    assert verdict["log"] == {"frames_lost": frames, "frames_foreign": None, "frames_unsent": None}
    assert verdict["incomplete"] == (["bus_load"] if frames else [])
    assert [check["passed"] for check in verdict["checks"]] == [None if frames else True, True]
    assert verdict["verdict"] == ("not-judged" if frames else "passed")
    suite = ElementTree.parse(tmp_path / "junit.xml").getroot()[0]
    assert (suite.get("failures"), suite.get("errors")) == ("0", "1" if frames else "0")
    errors = [error.get("message").partition(" frames")[0] for error in suite.iter("error")]
    assert errors == (["bus_load is not judged: can.log lacks 800"] if frames else [])
    assert not any(suite.iter("skipped"))
    page = (tmp_path / "report.html").read_text()
    assert ("LOG INCOMPLETE" in page) is bool(frames)
    assert ("can.log lacks 800 frames; incomplete: bus_load" in page) is bool(frames)
    assert open_run(tmp_path).judged.lost_frames == finished.lost_frames


def test_a_figure_that_the_run_cannot_give_fails_its_check(tmp_path):
    made_up = make_run()
    made_up.impacts = {name: values[:0] for name, values in made_up.impacts.items()}
    made_up.scenario["checks"] = [{"name": "capture_s", "high": 10.0}]
    verdict = finish(write_run(made_up, tmp_path)).as_json()
    assert verdict["checks"][0]["value"] is None
    assert not verdict["passed"]
    assert (
        "capture_s is not there, wanted ≤ 10 s: the run does not have this figure"
        in (tmp_path / "junit.xml").read_text()
    )


@pytest.mark.parametrize("lost", ["firmware.trace", "plant.trace", "outcome.json"])
def test_a_run_that_lost_something_still_ends_in_a_failed_verdict_that_says_why(tmp_path, lost):
    run_dir = write_run(make_run(), tmp_path)
    (run_dir / lost).unlink()
    verdict = finish(run_dir).as_json()
    assert not verdict["passed"]
    assert any(lost.split(".")[0] in reason for reason in verdict["reasons"])
    assert verdict["reasons"][0] in (run_dir / "report.html").read_text().replace("&#39;", "'")
    assert rerun(["rrd", "verify", run_dir / "run.rrd"]).returncode == 0


@pytest.mark.parametrize("lost", ["firmware.trace", "plant.trace"])
def test_no_check_passes_where_a_node_left_nothing(tmp_path, lost):
    made_up = make_run()
    made_up.scenario["checks"] = [
        {"name": "fault", "equals": "none"},
        {"name": "impact_count", "low": 0},
        {"name": "ticks", "low": 0},
        {"name": "final_mode", "equals": "none" if lost == "firmware.trace" else "ready"},
    ]
    run_dir = write_run(made_up, tmp_path)
    (run_dir / lost).unlink()
    verdict = finish(run_dir).as_json()
    assert [(check["passed"], check["value"]) for check in verdict["checks"]] == [(False, None)] * 4
    assert "fault is not there, wanted = none: " in (run_dir / "junit.xml").read_text()


def test_the_report_stands_alone_and_says_the_verdict_first(finished):
    run_dir, _ = finished
    text = (run_dir / "report.html").read_text()
    page = Page(text)
    assert page.open == []
    assert page.references == ["run.rrd", "can.log", "scenario.toml", "verdict.json"]
    assert "http:" not in text
    assert "https:" not in text
    assert "<script" not in text
    said = "".join(page.words[page.words.index("PASSED") :])
    for word in ("A made-up run", "detector.recall", "0.1.0", "hunt-crossley"):
        assert word in said
    assert "prefers-color-scheme: dark" in text
    assert len(text) < 100_000


def test_the_report_says_what_was_injected_and_what_the_firmware_latched(tmp_path):
    made_up = make_run()
    fault = RunFault("sensor-stuck", "plant", False, 2.0, 2.5, "sensor-stuck (sensor striker)")
    made_up.run["faults"] = [fault._asdict()]
    made_up.firmware["outputs.fault"][-10:] = Fault.SENSOR_TIMEOUT
    latched_s = made_up.firmware["t_s"][-10]
    finish(write_run(made_up, tmp_path))
    words = Page((tmp_path / "report.html").read_text()).words
    assert "Injected fault at 2 s: sensor-stuck (sensor striker)." in words
    after = "4.99 s after the injected fault sensor-stuck (sensor striker)"
    assert f"The firmware latched the fault sensor-timeout at {latched_s:.4f} s, {after}." in words


def test_a_run_of_an_earlier_version_says_that_it_lacks_its_faults(tmp_path, capsys):
    made_up = make_run()
    made_up.scenario["script"] = {"faults": [{"kind": "killed", "at_s": 2.0, "process": "plant"}]}
    finish(write_run(made_up, tmp_path))
    sentence = "run.json does not say when the scenario's faults acted"
    assert any(sentence in text for text in Page((tmp_path / "report.html").read_text()).words)
    cli.run(["inspect", str(tmp_path)])
    assert sentence in " ".join(capsys.readouterr().out.split())


def test_the_report_escapes_what_a_scenario_says(tmp_path):
    made_up = make_run()
    made_up.scenario["title"] = "<script>alert(1)</script>"
    finish(write_run(made_up, tmp_path))
    assert "<script>alert" not in (tmp_path / "report.html").read_text()


def test_a_suite_has_one_page_and_one_junit_file(finished, tmp_path):
    _, verdict = finished
    other = replace(verdict, figures=replace(verdict.figures, scenario="other"))
    both = [in_a_suite(verdict), in_a_suite(failed_for(other, ["plant left no trace"]))]
    write_suite_report(tmp_path / "index.html", both, trace(both))
    text = (tmp_path / "index.html").read_text()
    page = Page(text)
    assert page.open == []
    words = " ".join(page.words)
    assert "1 of 2 scenarios passed" in words
    assert "plant left no trace" in words
    first, second = re.findall(r'<a class="(\S+)"[^>]* title="(\w+)', text)
    assert first == ("failed", "other")
    assert second[0] == "passed"
    suites = ElementTree.fromstring(junit_document(both).split("\n", 1)[1])
    assert [suite.get("errors") for suite in suites] == ["0", "1"]


def test_the_report_lists_how_the_run_was_made_in_plain_words(tmp_path):
    made_up = make_run()
    made_up.run["changes"] = ["firmware.start.rise_s=0.1", "firmware.start.attempts=0"]
    made_up.run["realtime"] = {"plant": {"scheduler": "deadline"}}  # run.json alone has it
    finish(write_run(made_up, tmp_path))
    words = Page((tmp_path / "report.html").read_text()).words
    made_with = words[words.index("Made with") :]
    assert "firmware.start.rise_s=0.1, firmware.start.attempts=0" in made_with
    assert made_with[made_with.index("kernel_can") + 1] == "no"
    assert made_with[made_with.index("wall_start_s") + 1] == "1000.0"
    assert not {"True", "False", "realtime"} & set(made_with)


def test_a_suites_page_begins_with_the_checks_that_flipped(finished, tmp_path):
    _, verdict = finished
    change = {"scenario": "one", "unit": "N", "limit": "≤ 9", "equal": False, "verdict": "differs"}
    change |= {"before": 1.0, "after": 10.0, "margin_before": 8.0, "margin_after": -1.0}
    flipped = {**change, "figure": "turned", "flipped": True, "passed_before": True, "passed_after": False}
    other = {**change, "figure": "unflipped", "flipped": False, "passed_before": True, "passed_after": True}
    write_suite_report(tmp_path / "index.html", [in_a_suite(verdict)], trace([verdict]), [other, flipped])
    words = " ".join(Page((tmp_path / "index.html").read_text()).words)
    order = ["1 check has another verdict", "turned", "Scenarios", verdict.scenario]
    order += ["Beside the baseline", "unflipped"]
    places = [words.index(word, words.index("PASSED")) for word in order]
    assert places == sorted(places)


def test_a_suites_page_lists_the_requirements_that_its_runs_prove(finished, tmp_path):
    _, verdict = finished
    first, *others = verdict.checks
    proving = replace(verdict, checks=(replace(first, requirement="P-01"), *others))
    said = []
    for given in (verdict, proving):
        write_suite_report(tmp_path / "index.html", [in_a_suite(given)], trace([given]))
        said.append(" ".join(Page((tmp_path / "index.html").read_text()).words))
    text = requirements()["P-01"].text
    assert "Requirements" not in said[0]
    assert text in said[1]
    others = ", ".join(name for name in requirements() if name != "P-01")
    assert said[1].partition("No check of these runs proves ")[2].startswith(f"{others}.")


@pytest.mark.parametrize(
    ("missed", "named", "high_n"),
    [(5, True, 100.0), (40, True, 1000.0), (2, False, 100.0), (2, False, 1000.0)],
)
def test_a_check_whose_window_a_stall_of_the_host_touches_is_not_judged(tmp_path, missed, named, high_n):
    made_up = make_run()
    kept = np.setdiff1d(np.arange(len(made_up.firmware["tick"])), np.arange(3000, 3000 + missed))
    made_up.firmware = {name: values[kept] for name, values in made_up.firmware.items()}
    made_up.outcome["baseline_overruns"] = 1000  # so that overruns alone say nothing
    made_up.scenario["checks"] = [
        {"name": "peak_force_n", "high": high_n, "unit": "N"},
        {"name": "before", "expression": "max(plant.omega_rad_s)", "to_s": 2.5, "high": 99.0},
        {"name": "settled", "expression": "max(plant.omega_rad_s)", "from_s": 5.1, "high": 99.0},
        {"name": "within", "expression": "max(plant.omega_rad_s)", "from_s": 4.9, "high": 99.0},
        {"name": "overruns", "high": 1.0},
    ]
    verdict = finish(write_run(made_up, tmp_path)).as_json()
    assert verdict["real_time"] is not named
    judged = "passed" if high_n == 1000.0 else "failed"
    assert [check["verdict"] for check in verdict["checks"]] == [
        "not-judged" if named else judged,
        "passed",
        "passed",
        "not-judged" if named else "passed",
        "failed",
    ]
    stall = "held up the firmware from 2.999 s to"
    assert (stall in (tmp_path / "junit.xml").read_text()) is named
    assert (stall in html.unescape((tmp_path / "report.html").read_text())) is named


@pytest.mark.parametrize(
    "excuse",
    ["a pause of the scenario", "the firmware's own work"],
)
def test_a_stall_that_is_not_the_hosts_is_judged(tmp_path, excuse):
    made_up = make_run()
    kept = np.setdiff1d(np.arange(len(made_up.firmware["tick"])), np.arange(3000, 3040))
    made_up.firmware = {name: values[kept] for name, values in made_up.firmware.items()}
    made_up.firmware["cpu_us"] = np.zeros(len(kept))
    if excuse == "the firmware's own work":
        made_up.firmware["cpu_us"][2999] = 40_000.0
    else:
        made_up.run["faults"] = [RunFault("paused", "firmware", True, 3.0, 3.04, "paused")._asdict()]
    made_up.scenario["checks"] = [{"name": "peak_force_n", "high": 100.0, "unit": "N"}]
    verdict = finish(write_run(made_up, tmp_path)).as_json()
    assert verdict["gaps"] == []
    assert verdict["checks"][0]["verdict"] == "failed"
