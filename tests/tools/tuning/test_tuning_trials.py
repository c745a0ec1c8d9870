"""What trials of identification come to: shares, errors, and bounds that hold the truth or do not."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from hil.record import provenance
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_PASSED
from tools.tuning import trials
from tools.tuning.trials import GOAL, Trial, module_of, run_trials, summary


def trial(number: int, named: str = "", b_off: float = 0.0, held: bool = True) -> Trial:
    law, _ = module_of(number)
    return Trial(number, law, named or law, "", {"damping": b_off}, {"damping": held}, {})


def test_all_right_is_passed() -> None:
    said = summary([trial(number) for number in range(100)])
    assert said["passed"]
    assert said["named_right"]["hits"] == 100
    assert said["within"]["damping"]["in_bounds"]["value"] == 1.0


def test_errors_beyond_the_limit_miss_the_goal() -> None:
    """One in a hundred may be wrong, two may not."""
    assert GOAL == 0.99
    one_off = [trial(number, b_off=0.051 if number == 7 else 0.001) for number in range(100)]
    two_off = [trial(number, b_off=-0.051 if number in (7, 8) else 0.001) for number in range(100)]
    assert summary(one_off)["passed"]
    assert not summary(two_off)["passed"]
    assert summary(two_off)["within"]["damping"]["worst"] == 0.051


def test_a_wrong_law_is_reported_and_its_parameters_are_not_counted() -> None:
    trials = [trial(0, b_off=0.001), trial(1, named="stribeck", b_off=9.0), trial(2)]
    said = summary(trials)
    assert [one["trial"] for one in said["wrong"]] == [1]
    assert said["within"]["damping"]["n"] == 2
    assert not said["passed"]


def test_bounds_that_miss_the_truth_are_counted() -> None:
    said = summary([trial(number, held=number % 4 != 0) for number in range(40)])
    assert said["within"]["damping"]["in_bounds"]["hits"] == 30


def test_a_run_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of the same key are known, one cut short and one of other sources are not; none is lost."""
    path = tmp_path / "trials.jsonl"
    known = provenance.key(41, 20.0)
    lines = [json.dumps({"key": key, **asdict(trial(number))}) for key, number in ((known, 0), ("b", 1))]
    path.write_text("\n".join([*lines, lines[0][:40]]), encoding="utf-8")
    ran: list[int] = []

    @contextmanager
    def running(*_: object) -> Iterator[Any]:
        def run(numbers: list[int]) -> Iterator[tuple[int, Trial]]:
            ran.extend(numbers)
            yield from ((place, trial(number)) for place, number in enumerate(numbers))

        yield run

    monkeypatch.setattr(trials, "running", running)
    for _ in range(2):
        assert run_trials(3, path, seed=41, seconds=20.0) == [trial(number) for number in range(3)]
        assert ran == [1, 2]


def test_a_trial_is_recorded_identified_and_judged(tmp_path: Path) -> None:
    """The second call finds the first one's line."""
    path = tmp_path / "trials.jsonl"
    found = run_trials(1, path, seed=41, seconds=20.0, workers=1)
    assert [one.named for one in found] == ["viscous"]
    assert abs(found[0].errors["spring"] or 1.0) < 0.005
    assert set(found[0].held) == {"spring", "damping", "stop", "restitution"}
    written = path.read_bytes()
    assert run_trials(1, path, seed=41, seconds=20.0, workers=1) == found
    assert path.read_bytes() == written


@pytest.mark.parametrize("option", ["--plot", "--rrd", "--scene"])
def test_what_trials_do_not_use_is_refused(option: str, tmp_path: Path, capsys) -> None:
    value = str(tmp_path / {"--plot": "x.svg", "--rrd": "x.rrd", "--scene": "gait"}[option])
    assert cli.run(["tune", "identify", "--trials", "1", option, value]) == EXIT_BAD_INPUT
    assert f"leave out {option}" in " ".join(capsys.readouterr().err.split())


def test_the_command_goes_on_with_the_outcomes_of_the_named_file(tmp_path: Path, monkeypatch, capsys) -> None:
    path = tmp_path / "mine.jsonl"
    line = {"key": provenance.key(trials.SEED, trials.SECONDS), **asdict(trial(0))}
    path.write_text(json.dumps(line) + "\n", encoding="utf-8")
    monkeypatch.setattr(trials, "running", None)  # which computes those that are missing
    command = ["tune", "identify", "--trials", "1", "--trials-out", str(path), "--json"]
    assert cli.run(command) in (EXIT_PASSED, EXIT_CHECK_FAILED)
    said = json.loads(capsys.readouterr().out)
    assert (said["out"], said["named_right"]["hits"]) == (str(path), 1)
