"""The defaults against the tunings: what counts as agreement, and that disagreement is said."""

import json
from pathlib import Path

import pytest

from firmware_py.shell.parameters import DEFAULTS
from hil.scenario.parameter_file import read_document, values_of
from tools import cli
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED
from tools.tuning import check, detector, estimator, start
from tools.tuning.check import TOLERANCES, Effort, Tolerance, margins_of, rows_of
from tools.tuning.result import Tuning, tuned
from tools.tuning.speed import tune_speed


@pytest.mark.parametrize(
    ("tolerance", "default", "holds"),
    [
        (Tolerance(1.05), 1.04, True),
        (Tolerance(1.05), 1.06, False),
        (Tolerance(1.05), 0.96, True),
        (Tolerance(1.05), 0.95, False),
        (Tolerance(difference=0.1), 1.09, True),
        (Tolerance(difference=0.1), 0.89, False),
        (Tolerance(in_range=True), 1.9, True),
        (Tolerance(in_range=True), 2.1, False),
        (Tolerance(), 1.0, True),
        (Tolerance(), 1.001, False),
    ],
)
def test_agreement_is_what_the_tolerance_says(tolerance: Tolerance, default: float, holds: bool) -> None:
    assert tolerance.holds(default, 1.0, 0.5, 2.0) is holds


def test_every_tolerance_says_what_it_is() -> None:
    assert str(Tolerance(1.005)) == "± 0.5 %"
    assert str(Tolerance(2.0, in_range=True)) == "× or ÷ 2 or as good"
    assert str(Tolerance(difference=1e-4)) == "± 0.0001"
    assert all(str(tolerance) for tolerance in TOLERANCES.values())


def test_every_parameter_that_is_tuned_has_a_tolerance() -> None:
    assert {detector.PARAMETER, estimator.FLOOR, *estimator.GRID} <= set(TOLERANCES)
    assert set(TOLERANCES) <= set(DEFAULTS)
    assert not set(start.SPACE) & set(TOLERANCES)


@pytest.mark.parametrize("as_good", [True, False])
def test_a_start_agrees_by_what_it_does(as_good: bool) -> None:
    """By no value: another rise that performs alike is no disagreement, one that is beaten is."""
    values = {"start.rise_s": tuned("start.rise_s", 4.5, 4.5, 4.5)}
    (row,) = rows_of([Tuning("start", "", 41, "", values, {}, default_as_good=as_good)])
    assert row.passed is as_good


def test_the_speed_loops_defaults_are_what_tuning_gives() -> None:
    assert all(row.passed for row in rows_of([tune_speed()[0]]))


def test_a_default_that_tuning_does_not_give_is_reported() -> None:
    other = tune_speed(bandwidth_hz=15.0)[0]
    failed = [row.parameter for row in rows_of([other]) if not row.passed]
    assert "speed.gain_p_n_m_s" in failed


def test_margins_need_the_start_and_the_estimator() -> None:
    """What they are made of is named, so that a tuning that is left out is not taken for a margin of 0."""
    lonely = Tuning("speed", "", None, "", {"speed.gain_i_n_m": tuned("speed.gain_i_n_m", 1, 1, 1)}, {})
    with pytest.raises(KeyError):
        margins_of(Path(), [lonely], effort=None, progress=lambda *_: None)  # type: ignore[arg-type]


def test_the_whole_chain(tmp_path: Path, monkeypatch, capsys) -> None:
    """The command, each tuning looking at very little: what it says of the defaults is what it has tuned.

    Designed and identified values do not depend on how much is looked at: these defaults have to agree.
    """
    little = Effort(
        detector={"trials": 11, "floors_m_s2": (0.8, 1.5)},
        estimator={"modules": 2, "seconds": 20.0, "fresh_trials": 4},
        start={"candidates": 1, "trials": 4, "fresh_trials": 4},
        hold_trials=1,
        identify_trials=1,
    )
    monkeypatch.setattr(check, "QUICK", little)
    monkeypatch.setattr(start, "ROUNDS", 1)
    monkeypatch.setattr(start, "SCREENING_TRIALS", 1)
    code = cli.run(["tune", "check", "--quick", "--workers", "1", "--out", str(tmp_path), "--json"])
    payload = json.loads(capsys.readouterr().out)
    rows = {row["parameter"]: row for row in payload["parameters"]}
    assert set(rows) == set(TOLERANCES) | set(start.SPACE)
    assert len(rows) == len(payload["parameters"])
    for command in ("speed", "identify", "estimator", "detector", "start"):
        path = tmp_path / f"{command}.toml"
        tuned_values = values_of(read_document(path), path)
        assert tuned_values == {name: row["tuned"] for name, row in rows.items() if row["command"] == command}
        assert tuned_values
    assert all(row["default"] == DEFAULTS[name] for name, row in rows.items())
    sure = [row for row in rows.values() if row["command"] in ("speed", "identify")]
    assert [row["parameter"] for row in sure if not row["passed"]] == []
    assert {one["scenario"] for one in payload["safety"]} >= {"bounds", "e-stop-in-the-hold"}
    margins = {one["what"]: one for one in payload["margins"]}
    assert len(margins) == 9
    assert {one["command"] for one in payload["margins"]} == {one["command"] for one in rows.values()}
    b = margins["error of b from a minute, median"]
    assert 0.0 < b["default"] < 3.0
    ripple = margins["crank's speed ripple in the hold"]
    assert 0.0 < 10.0 * ripple["default"] < ripple["naive"]
    passed = all(row["passed"] for row in rows.values()) and all(one["passed"] for one in payload["safety"])
    assert payload["passed"] is passed
    assert code == (EXIT_PASSED if passed else EXIT_CHECK_FAILED)
