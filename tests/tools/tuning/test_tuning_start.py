"""The soft start's grid: a ramp's figures, the choice among its points, and the command on a few trials."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from plant_sim.arrays import FloatArray
from tools import cli
from tools.campaign.campaign import Outcome
from tools.output import EXIT_PASSED
from tools.tuning import safety, start
from tools.tuning.candidates import Sampling
from tools.tuning.criteria import starts_of
from tools.tuning.start import APPROACH, DEFAULT, GRID, RISE, ramp, tune_start


def test_a_ramp_has_the_figures_of_its_starts() -> None:
    outcomes = [
        Outcome(0, 0, metrics={"capture": 4.0, "energy": 1.0, "overshoot": 1.02}),
        Outcome(1, 0, metrics={"capture": 6.0, "energy": 3.0, "overshoot_low_r": 1.04}),
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
    assert (found.failures, found.overshoot, found.capture_p95_s) == (1, float("inf"), float("inf"))


def test_the_default_is_a_point_of_the_grid() -> None:
    assert all(DEFAULT[name] in values for name, values in GRID.items())


def like(values: Mapping[str, float], shortest_s: float) -> FloatArray:
    """Starts that a shorter rise captures sooner, with harder impacts below `shortest_s`; else all alike."""
    spread = np.random.default_rng(1).normal(0.0, 0.01, 200)
    rise_s = values.get(RISE, DEFAULT[RISE])
    impact = 1.0 + 0.1 * max(0.0, shortest_s - rise_s) + spread
    return np.array([np.zeros(200), impact, rise_s + 2.0 + spread, np.full(200, 3.0)])


@pytest.mark.parametrize("shortest_s", [2.0, 5.0])
def test_the_best_point_is_the_shortest_rise_without_harder_impacts(monkeypatch, shortest_s: float) -> None:
    def planted(_: str, candidates: Sequence[Mapping[str, float]], *__: object) -> list[FloatArray]:
        return [like(one, shortest_s) for one in candidates]

    monkeypatch.setattr(start, "run_candidates", planted)
    monkeypatch.setattr(start, "starts_of", lambda starts: starts)
    monkeypatch.setattr(start, "fold_margins", dict)
    tuning, tried = tune_start(sampling=Sampling(workers=1))
    assert len(tried) == len(GRID[RISE]) * len(GRID[APPROACH])
    rise, approach = tuning.parameters[RISE], tuning.parameters[APPROACH]
    assert (rise.low, rise.value, rise.high) == (shortest_s, shortest_s, shortest_s)
    assert (approach.low, approach.high) == (min(GRID[APPROACH]), max(GRID[APPROACH]))
    assert tuning.default_as_good is False


def test_the_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.setattr(start.tune_start, "__defaults__", (*start.tune_start.__defaults__[:-1], SMALL))
    out, plot = tmp_path / "mine.toml", tmp_path / "mine.svg"
    command = ["tune", "start", "--trials", "8", "--fresh-trials", "8", "--workers", "1", "--json"]
    assert cli.run([*command, "--out", str(out), "--plot", str(plot)]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert [one["parameters"] for one in payload["tried"]] == [
        {RISE: rise, APPROACH: DEFAULT[APPROACH]} for rise in SMALL[RISE]
    ]
    assert all(one["failures"] == 0 for one in payload["tried"])
    assert payload["parameters"][RISE]["unit"] == "s"
    merits = payload["figures_of_merit"]
    assert merits["eligible"]["value"] >= 6
    assert merits["table1-viscous_fold_ratio"]["value"] == pytest.approx(0.108974292, abs=1e-8)
    assert merits["table1-viscous_fold_gap"] == {"value": pytest.approx(0.044558, abs=1e-6), "unit": "m"}
    assert out.exists()
    assert plot.stat().st_size > 10_000


SMALL = {RISE: (DEFAULT[RISE], 6.0), APPROACH: (DEFAULT[APPROACH],)}
