"""The detector's floor: the choice from a characteristic, and the campaign behind it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from firmware_py.shell.parameters import DEFAULTS
from tools import cli
from tools.campaign.campaign import Outcome
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, BadInputError
from tools.plots import drawn
from tools.tuning import safety
from tools.tuning.candidates import Sampling, run_candidates
from tools.tuning.detector import PARAMETER, Operating, choose, evaluate_floor, tune_detector
from tools.tuning.pictures import draw_detector
from tools.tuning.result import Tuning, Value

ANY = Operating(1.0, 100, 0, 0, 1.0, 1.0, 0.99, 1.0, 1.0, 1.4, 1.9, 0.0, 1.0, 0.0)


def characteristic(*costs: float) -> list[Operating]:
    return [replace(ANY, floor_m_s2=2.0**number, cost_1_h=cost) for number, cost in enumerate(costs)]


@pytest.mark.parametrize(
    ("costs", "floor", "low", "high"),
    [
        ((8.0, 5.0, 0.5, 0.0, 0.0, 0.5, 9.0), 8.0, 4.0, 32.0),
        ((9.0, 0.0, 9.0), 2.0, 2.0, 2.0),
        ((9.0, 0.0, 0.0, 9.0), 4.0, 2.0, 4.0),
        ((0.0, 9.0, 0.0), 1.0, 1.0, 1.0),  # a stretch has no holes
        ((0.0, 0.0, 0.0), 2.0, 1.0, 4.0),
    ],
)
def test_the_floor_stands_a_step_off_the_cliff(costs, floor: float, low: float, high: float) -> None:
    best, alike = choose(characteristic(*costs))
    assert (best.floor_m_s2, alike[0].floor_m_s2, alike[-1].floor_m_s2) == (floor, low, high)


def outcome(trial: int, hits: int, misses: int, false_alarms: int) -> Outcome:
    shares = {"recall": (hits, hits + misses), "precision": (hits, hits + false_alarms)}
    return Outcome(trial, 0, simulated_s=1800.0, shares=shares, samples={"latency": [1.0, 2.0, 3.0]})


def test_costs_are_what_is_stated() -> None:
    outcomes = [outcome(0, 90, 4, 1), outcome(1, 110, 0, 2)]
    point = evaluate_floor(1.5, outcomes, cost_miss=2.0, cost_false_alarm=10.0)
    assert point.hours == 1.0
    assert point.cost_1_h == 2.0 * 4 + 10.0 * 3
    assert point.cost_error_1_h == pytest.approx((2.0**2 * 4 + 10.0**2 * 3) ** 0.5)
    assert point.recall == pytest.approx(200 / 204)
    assert point.precision == pytest.approx(200 / 203)
    assert point.false_alarms_1_h == 3.0
    assert point.latency_p50_ms == 2.0


def test_what_chooses_does_not_judge() -> None:
    Sampling(41, 30_000)
    for seed, fresh_seed in ((10_000, 30_000), (41, 9_999)):
        with pytest.raises(BadInputError, match="chosen on a seed below 10000"):
            Sampling(seed, fresh_seed)
    for cost_miss in (0.0, 1e155):  # whose square has no value
        with pytest.raises(BadInputError, match=r"wanted both above 0 and at most 1e\+09"):
            tune_detector(cost_miss=cost_miss)


def test_candidates_meet_the_same_sampled_modules() -> None:
    """Twice the same candidate gives the same outcomes, and a high floor misses what another finds."""
    conditions = ((("viscous",), (1.1, 1.3), (0.0,)),)
    floors = (1.5, 1.5, 900.0)
    reports: list[float | None] = []
    same, again, deaf = run_candidates(
        "detect",
        [{PARAMETER: floor} for floor in floors],
        seed=41,
        trials=4,
        progress=lambda fraction, _: reports.append(fraction),
        workers=1,
        conditions=conditions,
    )
    assert [one.shares for one in same] == [one.shares for one in again]
    assert [one.samples for one in same] == [one.samples for one in again]
    assert [one.trial for one in same] == [0, 1, 2, 3]
    assert reports == sorted(reports)
    assert reports[-1] == 1.0
    shifted = evaluate_floor(1.5, same, 1.0, 1.0)
    misses = evaluate_floor(900.0, deaf, 1.0, 1.0)
    assert shifted.recall > 0.99
    assert misses.recall < 0.5


def test_the_picture_has_each_floor_and_the_choice(tmp_path: Path) -> None:
    points = [*characteristic(0.0, 0.0), replace(ANY, floor_m_s2=4.0, false_alarms_1_h=9.0)]
    tuning = Tuning("detector", "a test", 1, "a test", {PARAMETER: Value(2.0, "m/s^2", 1.0, 4.0)}, {})
    with drawn(tmp_path / "detector.svg") as figure:
        draw_detector(figure, tuning, points)
        misses = figure.axes[0]
        assert misses.get_lines()[0].get_xdata().tolist() == [1.0, 2.0, 4.0]
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        assert legend == ["no significant difference", "chosen", "default"]


def test_the_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.setattr("tools.tuning.detector.FLOORS_M_S2", (0.75, 1.5, 3.0))
    out, plot = tmp_path / "mine.toml", tmp_path / "mine.svg"
    command = ["tune", "detector", "--trials", "11", "--workers", "1", "--out", str(out)]
    assert cli.run([*command, "--plot", str(plot), "--json"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    value = payload["parameters"][PARAMETER]
    assert value["low"] <= value["value"] <= value["high"]
    assert value["unit"] == "m/s^2"
    assert payload["figures_of_merit"]["recall"]["value"] > 0.99
    assert payload["figures_of_merit"]["default_recall"]["value"] > 0.99
    latencies = [point["latency_p50_ms"] for point in payload["characteristic"]]
    assert latencies == sorted(latencies)  # the higher the floor, the later it is crossed
    assert plot.exists()
    assert out.exists()
    assert payload["seed"] < 10_000
    assert DEFAULTS[PARAMETER] == 1.5
    assert cli.run([*command, "--seed", "20000"]) == EXIT_BAD_INPUT
