"""The soft start's ramp: what counts first, and the command on a few draws."""

import json
from pathlib import Path

import pytest

from firmware_py.shell.parameters import DEFAULTS
from tools import cli
from tools.campaign.outcome import Outcome
from tools.output import EXIT_PASSED
from tools.tuning import safety, start
from tools.tuning.start import SPACE, Ramp, finished, ramp, study_in, with_front


def of(failures: int, overshoot: float, capture_s: float) -> Ramp:
    return Ramp({}, 100, failures, overshoot, capture_s, capture_s, 2.0)


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (of(0, 1.2, 9.0), of(1, 1.0, 3.0)),  # a start that fails outweighs all else
        (of(0, 1.04, 9.0), of(0, 1.2, 3.0)),  # then the blows on the way
        (of(0, 1.04, 3.0), of(0, 1.0, 9.0)),  # within what is allowed they do not count
    ],
)
def test_reliability_comes_first(better: Ramp, worse: Ramp) -> None:
    assert better.rank < worse.rank


def test_a_ramp_is_what_its_starts_came_to() -> None:
    outcomes = [
        Outcome(0, 0, metrics={"capture": 4.0, "energy": 1.0, "overshoot": 1.02}),
        Outcome(1, 0, metrics={"capture": 6.0, "energy": 3.0, "overshoot_low": 1.04}),
        Outcome(2, 0, why="ends in fault"),
        Outcome(3, 0, eligible=False, why="no impact attractor at this speed"),
    ]
    found = ramp({"start.rise_s": 5.0}, outcomes)
    assert (found.eligible, found.failures) == (3, 1)
    assert found.overshoot == 1.04
    assert found.capture_p50_s == 5.0
    assert found.success_low < 2 / 3
    assert found.energy_p50_j == 2.0


def test_the_front_is_what_nothing_beats_in_all_aims() -> None:
    tried = [of(0, 1.1, 9.0), of(0, 1.2, 3.0), of(0, 1.2, 9.0), of(1, 1.0, 3.0), of(1, 1.3, 9.0)]
    assert [one.on_front for one in with_front(tried)] == [True, True, False, True, False]
    assert [one.on_front for one in with_front([tried[0], tried[0]])] == [True, True]


def test_the_search_begins_with_the_default_until_that_is_known(tmp_path: Path) -> None:
    """Also after a kill between asking for it and knowing it."""
    default = {name: DEFAULTS[name] for name in SPACE}
    for _ in range(2):
        study = study_in(tmp_path / "start.journal", "mine", 1)
        trial = study.ask()
        values = {
            name: trial.suggest_float(name, low, high, step=step) for name, (low, high, step) in SPACE.items()
        }
        assert values == pytest.approx(default)
        assert finished(study) == []
    numbers = vars(of(0, 1.0, 5.0))
    trial.set_user_attr(
        "ramp", {key: numbers[key] for key in numbers if key not in ("parameters", "on_front")}
    )
    study.tell(trial, [0.0, 1.0, 5.0, 2.0])
    (known,) = finished(study_in(tmp_path / "start.journal", "mine", 1))
    assert known.parameters == pytest.approx(default)
    assert finished(study_in(tmp_path / "start.journal", "other", 1)) == []


def test_the_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    out, journal = tmp_path / "mine.toml", tmp_path / "mine.journal"
    command = ["tune", "start", "--trials", "12", "--fresh-trials", "12", "--workers", "1", "--json"]
    files = ["--out", str(out), "--plot", str(tmp_path / "mine.svg"), "--rrd", str(tmp_path / "mine.rrd")]
    assert cli.run([*command, *files, "--candidates", "2"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    default = payload["tried"][0]
    assert default["parameters"] == pytest.approx({name: DEFAULTS[name] for name in SPACE})
    assert default["failures"] == 0
    assert payload["parameters"]["start.rise_s"]["unit"] == "s"
    assert payload["figures_of_merit"]["eligible"]["value"] >= 8
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
