"""A result as tables: what is printed is what the JSON object has, under the same names."""

import math

import numpy as np
import pytest

from tools import cli
from tools.output import EXIT_PASSED, answer, console, show_tables


def printed(payload: dict, capsys: pytest.CaptureFixture[str]) -> list[str]:
    show_tables(payload)
    return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]


def test_values_and_records_have_their_names(capsys) -> None:
    rows = [
        {"what": "[a]", "kind": "solver", "cost": 1.25},
        {"what": "b", "kind": "solver", "cost": math.inf},
    ]
    metrics = {"energy": {"n": 3, "worst": 2.0, "inner": {"x": 1}}, "capture": {"n": 3, "worst": math.nan}}
    payload = {
        "out": "here",
        "peak_felt_force_n": None,
        "reason": "",
        "final": {"x_m": 0.18},
        "rows": rows,
        "metrics": metrics,
        "notes": ["one", "two"],
    }
    lines = printed(payload, capsys)
    assert lines[:4] == ["out here", "final.x_m 0.18", "notes one", "two"]
    assert lines[4:9] == ["", "rows each with kind = solver", "what cost", "[a] 1.25", "b inf"]
    assert lines[9:] == ["", "metrics each with n = 3", "name worst inner.x", "energy 2 1", "capture — —"]


def test_of_many_the_first_records_and_the_last_number_are_shown(capsys) -> None:
    payload = {"times_s": np.arange(100.0), "few": [1, 2], "rows": [{"n": n} for n in range(50)], "none": []}
    lines = printed(payload, capsys)
    assert lines[:3] == ["times_s 100, the last 99", "few 1, 2", ""]
    assert lines[3] == "rows the first 40 of 50, --json has all"
    assert lines[-1] == "39"


def test_a_table_that_is_wider_than_the_terminal_is_printed_in_blocks_of_whole_columns(
    capsys, monkeypatch
) -> None:
    monkeypatch.setattr(console, "_width", 40)
    rows = [{"id": n, "name": f"frame {n}", **{f"response_{k}_s": n + 0.125 for k in "abc"}} for n in (1, 2)]
    lines = printed({"frames": rows}, capsys)
    assert lines == [
        *("", "frames", "name id response_a_s response_b_s"),
        *("frame 1 1 1.125 1.125", "frame 2 2 2.125 2.125"),
        *("", "name response_c_s", "frame 1 1.125", "frame 2 2.125"),
    ]


@pytest.mark.parametrize("command", [["schedule"], ["runs"]])
def test_no_figure_is_cut_on_eighty_columns(command, capsys, monkeypatch, tmp_path) -> None:
    run = tmp_path / "runs" / "20261127-181207-the-longest-name-of-a-scenario-that-anyone-has"
    run.mkdir(parents=True)
    (run / "run.json").write_text('{"made_by": "vibrohil", "scenario": "soft-start-multistable"}')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "_width", 80)
    assert cli.run(command) == EXIT_PASSED
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize(("passed", "word"), [(True, "PASSED"), (False, "FAILED"), (None, "NOT JUDGED")])
def test_a_verdict_comes_last(passed, word, capsys) -> None:
    assert printed({"passed": passed, "rows": [{"a": 1}]}, capsys)[-1] == word


def test_an_answer_without_a_printer_of_its_own_is_tables(capsys) -> None:
    answer({"a": 1}, as_json=False)
    assert capsys.readouterr().out.split() == ["a", "1"]
    answer({"a": math.inf}, as_json=True)
    assert capsys.readouterr().out == '{"a": null}\n'
