"""The soft start's ramp: what counts first, and the command on a few trials."""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.record import provenance
from plant_sim.arrays import FloatArray
from tools import cli
from tools.campaign.trial.outcome import Outcome
from tools.output import EXIT_PASSED
from tools.tuning import safety, start
from tools.tuning.criteria import starts_of
from tools.tuning.start import (
    DEFAULT,
    SPACE,
    Ramp,
    asked,
    final,
    finished,
    name_of_search,
    neighbours,
    ramp,
    screened,
    study_in,
    with_front,
)


def of(failures: int, overshoot: float, capture_s: float) -> Ramp:
    return Ramp({}, 100, failures, overshoot, overshoot, capture_s, capture_s, 2.0)


def test_a_ramp_is_what_its_starts_came_to() -> None:
    outcomes = [
        Outcome(0, 0, metrics={"capture": 4.0, "energy": 1.0, "overshoot": 1.02}),
        Outcome(1, 0, metrics={"capture": 6.0, "energy": 3.0, "overshoot_low": 1.04}),
        Outcome(2, 0, why="ends in fault"),
        Outcome(3, 0, eligible=False, why="no impact attractor at this speed"),
    ]
    found = ramp({"start.rise_s": 5.0}, starts_of(outcomes))
    assert (found.eligible, found.failures) == (3, 1)
    assert found.largest == 1.04
    assert found.overshoot == 1.04
    assert found.capture_p50_s == 5.0
    assert found.success_low < 2 / 3
    assert found.energy_p50_j == 2.0


def test_a_ramp_without_a_capture_is_the_worst() -> None:
    found = ramp({}, starts_of([Outcome(0, 0, why="never started")]))
    assert found.objectives == (1.0, float("inf"), float("inf"), float("inf"))


def test_the_front_is_what_nothing_beats_in_all_aims() -> None:
    tried = [of(0, 1.1, 9.0), of(0, 1.2, 3.0), of(0, 1.2, 9.0), of(1, 1.0, 3.0), of(1, 1.3, 9.0)]
    assert [one.on_front for one in with_front(tried)] == [True, True, False, True, False]
    assert [one.on_front for one in with_front([tried[0], tried[0]])] == [True, True]


def test_the_search_begins_with_the_default_until_that_is_known(tmp_path: Path) -> None:
    """Also after a kill between asking for it and knowing it."""
    for _ in range(2):
        study = study_in(tmp_path / "start.journal", "mine", 1)
        ((trial, values),) = asked(study, 1, free=())
        assert values == DEFAULT
        assert finished(study) == []
    trial.set_user_attr("ramp", {**vars(of(0, 1.0, 5.0)), "parameters": values})
    study.tell(trial, [0.0, 1.0, 5.0, 2.0])
    (known,) = finished(study_in(tmp_path / "start.journal", "mine", 1))
    assert known.parameters == DEFAULT
    assert finished(study_in(tmp_path / "start.journal", "other", 1)) == []


def test_what_is_free_keeps_its_default(tmp_path: Path) -> None:
    free = ("start.again_s", "hold.rate_1_s")
    study = study_in(tmp_path / "start.journal", "mine", 1)
    found = [values for _, values in asked(study, 6, free)]
    assert {values[name] == DEFAULT[name] for values in found for name in free} == {True}
    assert len({values["start.rise_s"] for values in found}) > 1


def like(values: Mapping[str, float], quickest_s: float) -> FloatArray:
    """Starts that a quicker rise captures sooner, with harder impacts below `quickest_s`; else all alike."""
    spread = np.random.default_rng(1).normal(0.0, 0.01, 200)
    rise_s = values["start.rise_s"]
    impact = 1.0 + 0.1 * max(0.0, quickest_s - rise_s) + spread
    return np.array([np.zeros(200), impact, rise_s + 2.0 + spread, np.full(200, 3.0)])


def test_what_changes_nothing_is_free() -> None:
    free = screened(lambda some: [like(values, 3.0) for values in some])
    assert free == tuple(name for name in SPACE if name != "start.rise_s")


@pytest.mark.parametrize("first", [3.5, 8.0])
def test_wherever_the_search_has_led_the_final_ends_at_the_best(first: float) -> None:
    """The quickest rise without harder impacts, which neither of these searches has tried."""
    free = tuple(name for name in SPACE if name != "start.rise_s")
    tried = with_front([replace(of(0, 1.0, 5.0), parameters={**DEFAULT, "start.rise_s": first})])
    found = final(tried, free, lambda some: [like(values, 3.0) for values in some])
    assert found.best == {**DEFAULT, "start.rise_s": 3.0}
    assert found.alone["start.rise_s"] == [3.0]
    assert set(found.alone["start.again_s"]) == {0.5, DEFAULT["start.again_s"], 4.0}


def test_neighbours_stay_within_what_is_searched() -> None:
    one = {**DEFAULT, "start.rise_s": 1.0, "start.approach_ratio": 0.9}
    around = neighbours(one, free=("hold.rate_1_s",))
    assert {values["start.rise_s"] for values in around} == {1.0, 1.5}
    assert {values["start.approach_ratio"] for values in around} == {0.8, 0.9}
    assert {values["hold.rate_1_s"] for values in around} == {DEFAULT["hold.rate_1_s"]}


def test_a_search_of_edited_sources_is_another_one(monkeypatch) -> None:
    before = name_of_search([24, 96, 1])
    monkeypatch.setattr(provenance, "sources", lambda: "edited")
    assert name_of_search([24, 96, 1]) != before


def test_the_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.setattr(start, "ROUNDS", 1)
    monkeypatch.setattr(start, "SCREENING_TRIALS", 1)
    out, journal = tmp_path / "mine.toml", tmp_path / "mine.journal"
    command = ["tune", "start", "--trials", "8", "--fresh-trials", "8", "--workers", "1", "--json"]
    files = ["--out", str(out), "--plot", str(tmp_path / "mine.svg"), "--rrd", str(tmp_path / "mine.rrd")]
    assert cli.run([*command, *files, "--candidates", "2"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    default = payload["tried"][0]
    assert default["parameters"] == DEFAULT
    assert default["failures"] == 0
    assert payload["parameters"]["start.rise_s"]["unit"] == "s"
    assert payload["figures_of_merit"]["eligible"]["value"] >= 6
    assert out.exists()
    assert (tmp_path / "mine.rrd").stat().st_size > 10_000

    # The same command with more candidates goes on where this one ended: one more is run, not three.
    asked: list[int] = []
    real = start.run_candidates
    monkeypatch.setattr(
        start, "run_candidates", lambda name, some, *rest: asked.append(len(some)) or real(name, some, *rest)
    )
    assert journal.exists()
    assert cli.run([*command, *files, "--candidates", "3"]) == EXIT_PASSED
    again = json.loads(capsys.readouterr().out)
    assert asked[0] == 1
    for before, after in zip(payload["tried"], again["tried"], strict=False):
        assert {**before, "on_front": None} == {**after, "on_front": None}


def test_a_journal_may_have_a_name_of_its_own(tmp_path: Path, monkeypatch) -> None:
    named: list[Path] = []
    monkeypatch.setattr(start, "tune_start", lambda journal, **_: named.append(journal) or sys.exit(0))
    journal, out = tmp_path / "search", tmp_path / "mine.toml"
    for options in ([], ["--journal", str(journal)]):
        with pytest.raises(SystemExit):
            cli.run(["tune", "start", "--out", str(out), *options])
    assert named == [tmp_path / "mine.journal", journal]
