"""The catalogue of runs: found below a folder, chosen by their figures, removed only on request."""

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from hil.judge.judge import judge
from hil.judge.verdict import CheckResult, Verdict
from hil.record import run_folder
from hil.record.run_traces import RunTraces
from tools import cli
from tools.commands.run import show_checks
from tools.commands.suite import line_of
from tools.output import EXIT_BAD_INPUT, EXIT_NOTHING_RAN, EXIT_PASSED, console
from tools.runs import catalogue as runs

VERDICTS = {
    "good": {"scenario": "one", "passed": True, "impact_v_m_s": 0.91, "fault": "none"},
    "suite/soft": {"scenario": "two", "passed": False, "impact_v_m_s": 0.5, "fault": "drive-timeout"},
    "suite/none": {"scenario": "three", "passed": False, "impact_v_m_s": None, "fault": "none"},
}


@pytest.fixture
def folder(tmp_path):
    for age_days, (name, verdict) in enumerate(VERDICTS.items()):
        run = tmp_path / name
        run.mkdir(parents=True)
        (run / "run.json").write_text('{"made_by": "vibrohil"}')
        (run / "verdict.json").write_text(json.dumps(verdict))
        os.utime(run / "run.json", (time.time() - 86_400.0 * age_days,) * 2)
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "run.json").write_text("{}")
    (tmp_path / "cut" / "verdict.json").write_text('{"passed": tr')
    (tmp_path / "foreign").mkdir()
    return tmp_path


def names(found, folder):
    return [str(run.folder.relative_to(folder)) for run in found]


def test_every_run_is_listed_the_newest_first(folder):
    assert names(runs.list_runs(folder), folder) == ["cut", "good", "suite/soft", "suite/none"]


@pytest.mark.parametrize(("stated", "is_taken"), [(1.5e9, True), (-1.0, False), (1e300, False), ("x", False)])
def test_a_run_began_when_its_note_says_whenever_that_was_written_again(folder, stated, is_taken):
    note = folder / "suite" / "none" / "run.json"
    note.write_text(json.dumps({"begun_s": stated}))
    (found,) = [run for run in runs.list_runs(folder) if run.folder == note.parent]
    assert found.begun_s == (stated if is_taken else note.stat().st_mtime)


@pytest.mark.parametrize(
    ("conditions", "wanted"),
    [
        (["passed=true"], ["good"]),
        (["impact_v_m_s > 0.4"], ["good", "suite/soft"]),
        (["impact_v_m_s>0.4", "impact_v_m_s<=0.5"], ["suite/soft"]),
        (["fault != none"], ["suite/soft"]),
        (["scenario=three"], ["suite/none"]),
        (["verdict=failed"], ["suite/soft", "suite/none"]),
        (["verdict!=failed"], ["good"]),
    ],
)
def test_conditions_choose_runs_by_their_figures(folder, conditions, wanted):
    assert names(runs.choose(runs.list_runs(folder), conditions), folder) == wanted


def test_the_command_lists_chooses_and_prunes(folder, capsys):
    assert cli.run(["runs", str(folder), "--where", "passed=false", "--json"]) == EXIT_PASSED
    listed = json.loads(capsys.readouterr().out)["runs"]
    assert [run["scenario"] for run in listed] == ["two", "three"]
    assert listed[0]["figures"]["fault"] == "drive-timeout"
    assert cli.run(["runs", str(folder), "--json", "--show", "verdict", "--show", "passed"]) == EXIT_PASSED
    shown = [run["figures"] for run in json.loads(capsys.readouterr().out)["runs"]]
    assert shown[:2] == [{"verdict": None, "passed": None}, {"verdict": "passed", "passed": True}]
    assert cli.run(["runs", str(folder)]) == EXIT_PASSED
    assert "4 of 4 runs" in capsys.readouterr().out
    assert cli.run(["runs", str(folder), "--most", "1"]) == EXIT_PASSED
    assert "1 of 4 runs" in capsys.readouterr().out
    assert cli.run(["runs", str(folder), "--where", "passed=false"]) == EXIT_PASSED
    assert "2 of 2 matching runs of 4" in capsys.readouterr().out
    assert cli.run(["runs", str(folder), "--most", "2", "--json"]) == EXIT_PASSED
    assert len(json.loads(capsys.readouterr().out)["runs"]) == 2
    assert cli.run(["runs", str(folder), "--prune", "36h", "--json"]) == EXIT_PASSED
    assert json.loads(capsys.readouterr().out)["removed"] == [str(folder / "suite" / "none")]
    assert (folder / "foreign").exists()
    assert cli.run(["runs", str(folder), "--prune", "old"]) == EXIT_BAD_INPUT
    assert cli.run(["runs", str(folder / "foreign")]) == EXIT_NOTHING_RAN


def test_pruning_takes_only_the_listed_runs(folder, capsys):
    command = ["runs", str(folder), "--prune", "0d", "--where", "passed=false", "--most", "1", "--json"]
    assert cli.run(command) == EXIT_PASSED
    assert json.loads(capsys.readouterr().out)["removed"] == [str(folder / "suite" / "soft")]
    assert (folder / "suite" / "none").exists()


def test_pruning_takes_nothing_that_no_run_has_made(folder, capsys):
    (folder / "good" / "notes.txt").write_text("mine")
    assert cli.run(["runs", str(folder), "--prune", "0d", "--json"]) == EXIT_PASSED
    capsys.readouterr()
    assert [path.name for path in (folder / "good").iterdir()] == ["notes.txt"]
    assert (folder / "cut" / "run.json").exists(), "its run.json is another program's"
    assert not (folder / "suite" / "soft").exists()


def test_the_version_names_the_commit(capsys):
    assert cli.run(["--version"]) == EXIT_PASSED
    assert capsys.readouterr().out.startswith("vibrohil 0.1.0")


def failed(check, *reasons):
    """The verdict on a run without records in which this check has failed."""
    return replace(judge(RunTraces(), Path()), checks=(check,), reasons=reasons)


def test_names_and_paths_in_brackets_are_printed_as_they_are(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(console, "_width", 200)
    odd = "run [/bold] of [red]"
    run = tmp_path / odd
    run.mkdir(parents=True)
    (run / "run.json").write_text('{"made_by": "vibrohil"}')
    check = {"name": odd, "value": odd, "unit": odd, "limit": odd, "passed": False, "verdict": "failed"}
    check |= {"reason": None, "requirement": None, "required": None}
    (run / "verdict.json").write_text(json.dumps({"scenario": odd, "passed": False, "checks": [check]}))
    assert cli.run(["runs", str(tmp_path)]) == EXIT_PASSED
    assert capsys.readouterr().out.count(odd) == 2
    show_checks(failed(CheckResult(odd, Verdict.FAILED, odd, odd, odd), odd))
    assert "".join(capsys.readouterr().out.split()).count("".join(odd.split())) == 6
    assert line_of(check, many=False).count(r"\[/bold]") == 4


@pytest.mark.parametrize(
    ("requirement", "required", "named"),
    [(None, None, ""), ("S-15", None, " (S-15)"), ("S-03", "≤ 3", " (own limit; S-03 requires ≤ 3)")],
)
def test_a_failed_check_of_a_suite_names_its_requirement(requirement, required, named):
    check = {"name": "impact_count", "value": 2, "unit": "", "limit": "≤ 1", "reason": None}
    check |= {"verdict": "failed", "passed": False, "requirement": requirement, "required": required}
    assert line_of(check, many=False) == f"[red]impact_count = 2, wanted ≤ 1{named}[/]"


def test_verdicts_of_checks_are_whole_in_a_narrow_terminal(monkeypatch, capsys):
    monkeypatch.setattr(console, "_width", 40)
    name = "safe_state.impacts_after_the_stop"
    show_checks(failed(CheckResult(name, Verdict.FAILED, 247.123, "N", "200 … 260")))
    said = capsys.readouterr().out
    assert all(whole in said for whole in ("247.1 N", "200 … 260", "failed"))


def test_a_figure_to_show_that_no_run_has_is_refused(folder, capsys):
    assert cli.run(["runs", str(folder), "--show", "speeed.error"]) == EXIT_BAD_INPUT
    assert "--show 'speeed.error': no figure" in capsys.readouterr().err
    assert cli.run(["runs", str(folder), "--show", "speed.error", "--show", "passed"]) == EXIT_PASSED


@pytest.mark.parametrize("name", ["nowhere", "good/run.json"])
def test_a_place_that_is_no_folder_is_refused(folder, name, capsys):
    assert cli.run(["runs", str(folder / name), "--json"]) == EXIT_BAD_INPUT
    assert "is no folder" in json.loads(capsys.readouterr().out)["error"]


def test_without_any_run_so_far_none_is_listed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["runs", "--json"]) == EXIT_NOTHING_RAN
    assert json.loads(capsys.readouterr().out) == {"runs": []}


def begun_long_ago(folder):
    """A run's folder that `runs` lists, of 1970."""
    folder.mkdir(parents=True)
    run_folder.write_note(folder / "run.json", {"scenario": "mine"})
    os.utime(folder / "run.json", (0, 0))
    return folder


def test_a_run_in_progress_and_the_runs_of_a_suite_in_progress_are_not_pruned(tmp_path, capsys):
    free, going = begun_long_ago(tmp_path / "free"), begun_long_ago(tmp_path / "going")
    of_suite = begun_long_ago(tmp_path / "suite" / "mine")
    run_folder.write_note(tmp_path / "suite" / "suite.json", {})
    with run_folder.claimed("mine", going), run_folder.claimed("suite", of_suite.parent, "suite.json"):
        assert cli.run(["runs", str(tmp_path), "--prune", "1d", "--json"]) == EXIT_PASSED
        result = json.loads(capsys.readouterr().out)
        assert result["removed"] == [str(free)]
        assert set(result["in_use"]) == {str(going), str(of_suite)}
        assert [folder.exists() for folder in (free, going, of_suite)] == [False, True, True]
    assert cli.run(["runs", str(tmp_path), "--prune", "1d", "--json"]) == EXIT_PASSED
    assert [folder.exists() for folder in (going, of_suite)] == [False, False]


NO_VALUE = "wanted a number, true, false or a word"
NO_TEXT = "is no text; write a number, true or false"
REFUSED = dict.fromkeys(["impact_v_m_s", "speeed.error < 1", "< 3", "impact_v_m_s = fast"], "--where")
REFUSED |= {
    f"impact_count{sign}{value}": NO_VALUE for sign in "<=" for value in ("[1]", "null", "{}", '{"a": 1}')
}
REFUSED |= dict.fromkeys(['impact_count<"x"', "impact_count<0x10", "impact_count<<1", "passed=yes"], NO_TEXT)


@pytest.mark.parametrize("text", REFUSED)
def test_a_condition_that_no_figure_can_meet_is_refused(folder, capsys, text):
    assert cli.run(["runs", str(folder), "--where", text]) == EXIT_BAD_INPUT
    assert REFUSED[text] in " ".join(capsys.readouterr().err.split())


def test_a_figure_that_is_a_text_is_compared_with_any_word(folder):
    for text, status in (("scenario!=5", EXIT_PASSED), ("fault=5", EXIT_NOTHING_RAN)):
        assert cli.run(["runs", str(folder), "--where", text, "--json"]) == status


def test_a_folder_in_the_place_of_a_file_stays_and_stops_no_pruning(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text('{"made_by": "vibrohil"}')
    (tmp_path / "first" / "plant.trace").mkdir()
    pruned = runs.prune(runs.list_runs(tmp_path), -1.0, tmp_path)
    assert len(pruned.removed) == 2
    assert [one.relative_to(tmp_path).as_posix() for one in sorted(tmp_path.rglob("*"))] == [
        "first",
        "first/plant.trace",
    ]


ILL_TYPED = {
    "passed": [True],
    "provenance": ["x"],
    "scenario": {"a": 1},
    "impact_v_m_s": "x",
    "speed": "x",
    "estimate": [1],
    "fault": 1e999,
}


@pytest.mark.parametrize("key", ILL_TYPED)
def test_a_verdict_of_other_types_is_listed_without_what_it_lacks(tmp_path, key):
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "verdict.json").write_text(json.dumps({**VERDICTS["good"], key: ILL_TYPED[key]}))
    for more in (["--json"], [], ["--where", "impact_v_m_s > 0.1"], ["--show", "speed.ripple"]):
        assert cli.run(["runs", str(tmp_path), *more]) in (EXIT_PASSED, EXIT_NOTHING_RAN)
