"""The soft start's ramp: what counts first, and the command on a few draws."""

import json
from pathlib import Path

import pytest

from tools import cli
from tools.campaign.outcome import Outcome
from tools.output import EXIT_PASSED
from tools.tuning import safety
from tools.tuning.start import Ramp, ramp


def of(failures: int, overshoot: float, capture_s: float) -> Ramp:
    return Ramp({}, 100, failures, overshoot, capture_s, capture_s)


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
        Outcome(0, 0, metrics={"capture": 4.0, "overshoot": 1.02}),
        Outcome(1, 0, metrics={"capture": 6.0, "overshoot_low": 1.04}),
        Outcome(2, 0, why="ends in fault"),
        Outcome(3, 0, eligible=False, why="no impact attractor at this speed"),
    ]
    found = ramp({"start.rise_s": 5.0}, outcomes)
    assert (found.eligible, found.failures) == (3, 1)
    assert found.overshoot == 1.04
    assert found.capture_p50_s == 5.0
    assert found.success_low < 2 / 3


def test_the_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.setattr("tools.tuning.start.RISES_S", (0.3, 5.0))
    monkeypatch.setattr("tools.tuning.start.AGAINS_S", (2.0,))
    out = tmp_path / "mine.toml"
    command = ["tune", "start", "--trials", "12", "--fresh-trials", "12", "--workers", "1", "--json"]
    assert cli.run([*command, "--out", str(out), "--plot", str(tmp_path / "mine.svg")]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    by_rise = {one["parameters"]["start.rise_s"]: one for one in payload["tried"]}
    value = payload["parameters"]["start.rise_s"]
    assert value["unit"] == "s"
    assert by_rise[value["value"]]["failures"] == min(one["failures"] for one in payload["tried"])
    assert by_rise[5.0]["failures"] == 0
    assert payload["figures_of_merit"]["eligible"]["value"] >= 8
    assert out.exists()
