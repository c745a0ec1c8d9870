"""Q and R from logs: what innovations say, and that no truth is used."""

import json
from pathlib import Path

import numpy as np
import pytest
from short_run import make_run

from firmware_py.shell.parameters import BY_NAME
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, BadInputError
from tools.tuning import estimator, safety
from tools.tuning.candidates import Sampling, points_of
from tools.tuning.estimator import (
    FLOOR,
    MEMORY,
    NOISE,
    STOP,
    Combination,
    Log,
    course_of,
    mean_likelihood,
    sample_module,
    tune_estimator,
    value_of_floor,
    worth,
)
from tools.tuning.recordings import replay
from tools.tuning.recordings.recorded import read_received, record
from tools.tuning.result import Tuning

ALONE = Sampling(workers=1)
SMALL = {NOISE: (1e-5, 1e-4, 1e-3), MEMORY: (0.1, 0.3, 3.0), STOP: (1e-4, 3e-4)}


# --- innovations --------------------------------------------------------------------------------------


def test_innovations_as_large_as_said_are_the_most_likely() -> None:
    residuals = np.random.default_rng(1).normal(0.0, 0.3, 5000)
    by_std = {std: mean_likelihood(residuals, np.full(5000, std**2)) for std in (0.15, 0.3, 0.6)}
    likelihood, nis = by_std[0.3]
    assert nis == pytest.approx(1.0, abs=0.05)
    assert likelihood == max(by_std.values())[0]
    # E ln p = −½ (ln 2πσ² + 1)
    assert likelihood == pytest.approx(-0.5 * (np.log(2.0 * np.pi * 0.09) + 1.0), abs=0.03)


def test_a_quiet_sensor_gives_a_permitted_floor() -> None:
    least_m_s2 = BY_NAME[FLOOR].low
    floor = value_of_floor([0.2 * least_m_s2, 0.4 * least_m_s2, 2.0 * least_m_s2])
    assert (floor.value, floor.low, floor.high) == (least_m_s2, least_m_s2, 2.0 * least_m_s2)


def test_witnesses_are_counted_by_how_they_hang_together() -> None:
    noise = np.random.default_rng(2).normal(size=20_000)
    assert worth(noise) == pytest.approx(20_000, rel=0.1)
    assert worth(np.ones(500)) < 3.0
    # x ← a x + w: n (1 − a)/(1 + a)
    slow = np.zeros(20_000)
    for k in range(1, len(slow)):
        slow[k] = 0.9 * slow[k - 1] + noise[k]
    assert worth(slow) == pytest.approx(20_000 * 0.1 / 1.9, rel=0.25)


def test_every_combination_is_tried_once() -> None:
    found = points_of({NOISE: (1.0, 2.0), STOP: (3.0, 4.0, 5.0)})
    assert len(found) == 6
    assert {tuple(one.values()) for one in found} == {(a, b) for a in (1.0, 2.0) for b in (3.0, 4.0, 5.0)}


# --- logs ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty seconds at r = 1.1, in lockstep."""
    folder = tmp_path_factory.mktemp("estimator") / "run"
    settings = ("script.duration_s=30",)
    make_run(folder, 5, *settings)
    return folder


@pytest.fixture(scope="module")
def with_the_truth(recorded: Path) -> tuple[Tuning, list[Combination]]:
    return tune_estimator([recorded], fresh_trials=0, grid=SMALL, sampling=ALONE)


@pytest.mark.parametrize("stripped", ["run folder", "bare log"])
def test_no_parameter_depends_on_the_truth(
    recorded: Path, with_the_truth: tuple[Tuning, list[Combination]], tmp_path: Path, stripped: str
) -> None:
    """A log without its truth gives the same parameters."""
    with_truth, points = with_the_truth
    if stripped == "bare log":
        other = tmp_path / "bare.log"
        other.write_bytes((recorded / "can.log").read_bytes())
    else:
        other = tmp_path / "run"
        other.mkdir()
        for name in ("can.log", "scenario.toml"):
            (other / name).write_bytes((recorded / name).read_bytes())
    without, blind = tune_estimator([other], fresh_trials=0, grid=SMALL, sampling=ALONE)
    assert without.parameters == with_truth.parameters
    assert [point.likelihood for point in blind] == [point.likelihood for point in points]
    # 70 µg/√Hz behind 400 Hz, and counts
    assert with_truth.values[FLOOR] == pytest.approx(0.0146, rel=0.05)


def test_the_likeliest_of_sampled_modules_is_near_the_least_error() -> None:
    """Without knowing the truth, the touch-downs choose what comes near the best that was tried."""
    tuning, points = tune_estimator(modules=4, seconds=30.0, fresh_trials=0, grid=SMALL, sampling=ALONE)
    logs = []
    for number in range(4):
        cell, sampled = sample_module(ALONE.seed, number)
        done = record(cell, sampled, 30.0)
        logs.append((Log(dict(cell.firmware), read_received(done)), done.true("x_m")))

    def error_mm(parameters: dict[str, float]) -> float:
        courses = ((course_of(log, parameters)[:, replay.X], x_m) for log, x_m in logs)
        squares = [np.nanmean((course - x_m[-len(course) :]) ** 2) for course, x_m in courses]
        return 1e3 * float(np.median(np.sqrt(squares)))

    errors = [error_mm(point.parameters) for point in points]
    tuned = error_mm({name: tuning.values[name] for name in SMALL})
    assert tuned < 1.5 * min(errors)
    assert tuned < np.median(errors)
    assert tuning.figures_of_merit["nis_stop"].value <= estimator.LARGEST_NIS


def test_other_input_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="is not there"):
        tune_estimator([tmp_path / "nowhere"])
    with pytest.raises(BadInputError, match="below 10000"):
        tune_estimator(sampling=Sampling(seed=20_000))


def test_the_command(recorded: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.setattr(estimator, "GRID", SMALL)
    out, plot = tmp_path / "mine.toml", tmp_path / "mine.svg"
    command = ["tune", "estimator", str(recorded), "--fresh-trials", "0", "--workers", "1", "--json"]
    assert cli.run([*command, "--out", str(out), "--plot", str(plot)]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert payload["parameters"][MEMORY]["unit"] == "s"
    assert len(payload["tried"]) == 18
    assert out.exists()
    assert plot.stat().st_size > 10_000
    assert cli.run([*command[:2], str(tmp_path / "nowhere")]) == EXIT_BAD_INPUT
