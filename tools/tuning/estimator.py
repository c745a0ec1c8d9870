"""Q and R of the firmware's estimator from logs, by the likelihood of its innovations.

Each log is replayed through the estimator (`replay`) with every combination of three parameters: the process
noise of the velocity (Q), the correlation time of the model's error, within which N readings count as one
(R = N σ²), and the standard deviation of the stop's position (R at a touch-down). The criterion is the
innovation at a touch-down, where the stop measures the position independently of the accelerometer. Its
log-likelihood is summed over logs, weighted with the effective number of touch-downs (`innovations`).

The innovation in free flight is no criterion: the reading that corrects the state has also propagated it, so
that the likelihood is largest for a filter that follows the model's errors. On sampled modules it would
choose parameters with three times the error of velocity. The touch-downs, without the truth, choose
parameters within 5 % of the least error of position. A limit of NIS excludes combinations whose variance is
too small.

The sensor's own noise, a lower limit of the σ² that the filter learns, follows from the second differences of
the readings. NIS, a whiteness test, and errors against filterpy's smoother are reported too. If a log comes
with a truth, so are NEES and errors against the truth; no parameter depends on them.
"""

import math
import os
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from hil.scenario.parameter_file import nested
from plant_sim.arrays import FloatArray
from tools.campaign.trial.cells import LAWS, Cell
from tools.campaign.trial.sampling import Mismatch, sample
from tools.jobs import running
from tools.output import BadInputError
from tools.progress import Counted
from tools.tuning.candidates import FRESH_SEED, TUNING_SEED, refuse_same_seeds, run_candidates
from tools.tuning.recordings.readings import Ticks
from tools.tuning.result import Merit, Tuning, Value, tuned

NOISE, MEMORY, STOP = "estimator.velocity_noise_m_s", "estimator.model_memory_s", "estimator.stop_std_m"
FLOOR = "estimator.model_std_m_s2"
GRID: dict[str, tuple[float, ...]] = {
    NOISE: (1e-5, 3e-5, 1e-4, 3e-4, 1e-3),
    MEMORY: (0.03, 0.1, 0.3, 1.0, 3.0),
    STOP: (1e-4, 3e-4, 1e-3, 3e-3),
}
"""Half a decade apart: likelihood and errors change little within one step."""
CONDITIONS = (("viscous", 1.1), ("coulomb-0.2", 0.95), ("viscous", 1.3), ("coulomb", 1.1))
MODULES = 16
SECONDS = 40.0
SETTLING_SHARE = 0.25
"""Share of a log that is left out at its beginning, where the initial covariance still has an effect."""
LARGEST_NIS = 1.5
"""Largest median NIS at the stop. Too large a variance costs some accuracy, too small a one fails the run."""
NEAR = 1.92
"""Half of χ²₁'s 95 % quantile: a log-likelihood this near the best does not differ significantly from it."""
FRESH_TRIALS = 60
NAIVE = {MEMORY: 0.0, "estimator.initial_model_std_m_s2": 0.016, "estimator.largest_model_std_m_s2": 0.016}
"""The textbook's choice: R is the sensor's noise, and all readings count as independent."""


class Source(NamedTuple):
    """A log: a run folder or candump file, or a module sampled by seed and number."""

    path: str
    seed: int
    number: int
    seconds: float


class Log(NamedTuple):
    """The nominal parameters of a log's run, the sensors' frames, and the truth (x, v), shape (2, ticks)."""

    nominal: dict[str, Any]
    ticks: Ticks
    truth: FloatArray | None


class Score(NamedTuple):
    """The results of a log with a combination of parameters; errors in m and m/s."""

    flight: Any
    stop: Any
    x_to_smoother_m: float
    x_to_truth_m: float
    v_to_truth_m_s: float
    nees: float


class Worth(NamedTuple):
    """Effective numbers of a log's innovations, p-value of their whiteness, and the sensor's noise."""

    flight: float
    stop: float
    white_flight: float
    noise_m_s2: float


@dataclass(frozen=True)
class Combination:
    """A combination of parameters and its results over all logs."""

    parameters: dict[str, float]
    likelihood: float
    nis_flight: float
    nis_stop: float
    x_to_smoother_mm: float
    x_to_truth_mm: float
    v_to_truth_m_s: float
    nees: float


# --- in a process that compiles the firmware ----------------------------------------------------------


@lru_cache(maxsize=64)
def _log(source: Source) -> Log:
    return _of_file(Path(source.path)) if source.path else _sampled(source)


def _of_file(path: Path) -> Log:
    from hil.record.run_traces import column, read_trace
    from tools.tuning.identification.identify import nominal_of
    from tools.tuning.recordings.readings import read_ticks

    values = nominal_of(path)
    changed = {name: value for name, value in values.items() if value != DEFAULTS[name]}
    ticks = read_ticks(path, values["control.tick_s"])
    truth = None
    if path.is_dir() and (path / "plant.trace").exists():
        plant = read_trace(path / "plant.trace")
        rows = column(plant, "tick").astype(int)
        truth = np.full((2, len(ticks.low_m_s2)), np.nan)
        inside = rows < truth.shape[1]
        truth[0, rows[inside]], truth[1, rows[inside]] = (
            column(plant, "x_m")[inside],
            column(plant, "v_m_s")[inside],
        )
    return Log(nested(changed), ticks, truth)


def _sampled(source: Source) -> Log:
    from tools.tuning.recordings.recorded import record

    law, ratio = CONDITIONS[source.number % len(CONDITIONS)]
    cell = Cell(law, ratio, 0.0, LAWS[law].scene, LAWS[law].nominal)
    sampled = sample(cell.scene, Mismatch(), source.seed, source.number)
    ticks, truth = record(cell, sampled, source.seconds)
    return Log(deepcopy(dict(cell.firmware)), ticks, np.stack([truth.x_m, truth.v_m_s]))


def _course(log: Log, parameters: dict[str, float]) -> tuple[Any, FloatArray, int]:
    """Configuration, the estimator's history without its beginning, and the history's first tick."""
    from firmware_py.shell.parameters import config_from
    from tools.tuning.recordings.replay import replay

    firmware = deepcopy(log.nominal)
    for block, table in nested(parameters).items():
        firmware.setdefault(block, {}).update(table)
    config = config_from(firmware)
    begin = round(SETTLING_SHARE * len(log.ticks.low_m_s2))
    return config, replay(config, log.ticks)[begin:], begin


@lru_cache(maxsize=64)
def _yardstick(source: Source) -> Any:
    from tools.tuning.recordings.smoother import smoothed

    config, course, _ = _course(_log(source), {})
    return smoothed(config, course)


def weigh(source: Source) -> Worth:
    """Effective numbers of a log's innovations with the run's own parameters, and the sensor's noise."""
    from tools.tuning.recordings import replay
    from tools.tuning.recordings.innovations import whiteness, worth

    log = _log(source)
    config, course, _ = _course(log, {})
    flying, stop = course[course[:, replay.FLYING] > 0.0], course[course[:, replay.AT_STOP] > 0.0]
    y = flying[:, replay.INNOVATION] / flying[:, replay.INNOVATION_STD]
    nu = stop[:, replay.STOP_INNOVATION] / np.sqrt(stop[:, replay.STOP_VARIANCE])
    every = max(round(config.estimator.noise.readings_as_one), 1)
    # Second differences of white noise have 6 times its variance; median |x| of a normal is 0.6745 σ.
    bends = np.abs(np.diff(log.ticks.low_m_s2, 2))
    noise_m_s2 = float(np.nanmedian(bends)) / 0.6745 / math.sqrt(6.0)
    return Worth(worth(y), worth(nu), whiteness(y[::every]), noise_m_s2)


def score(source: Source, combinations: Sequence[dict[str, float]]) -> list[Score]:
    """The results of a log with each combination of parameters."""
    return [_score(source, parameters) for parameters in combinations]


def _score(source: Source, parameters: dict[str, float]) -> Score:
    from tools.tuning.recordings import replay
    from tools.tuning.recordings.innovations import said

    log, yardstick = _log(source), _yardstick(source)
    _, course, begin = _course(log, parameters)
    flying, stop = course[course[:, replay.FLYING] > 0.0], course[course[:, replay.AT_STOP] > 0.0]

    def rms(error: FloatArray) -> float:
        return float(np.sqrt(np.nanmean(error**2)))

    x_truth = v_truth = nees = math.nan
    if log.truth is not None:
        x_error = course[:, replay.X] - log.truth[0, begin:]
        v_error = course[:, replay.V] - log.truth[1, begin:]
        x_truth, v_truth = rms(x_error), rms(v_error)
        xx, xv, vv = (course[:, place] for place in (replay.P_XX, replay.P_XV, replay.P_VV))
        # eᵀ P⁻¹ e over (x, v); its mean is 2 for a consistent filter
        nees = float(
            np.nanmean(
                (vv * x_error**2 - 2.0 * xv * x_error * v_error + xx * v_error**2) / (xx * vv - xv * xv)
            )
        )
    return Score(
        flight=said(flying[:, replay.INNOVATION], flying[:, replay.INNOVATION_STD] ** 2),
        stop=said(stop[:, replay.STOP_INNOVATION], stop[:, replay.STOP_VARIANCE]),
        x_to_smoother_m=rms(course[:, replay.X] - yardstick.x_m),
        x_to_truth_m=x_truth,
        v_to_truth_m_s=v_truth,
        nees=nees,
    )


# --- all logs -----------------------------------------------------------------------------------------


def combinations_of(grid: dict[str, tuple[float, ...]]) -> list[dict[str, float]]:
    """Every combination of the grid's values."""
    points = np.stack(np.meshgrid(*grid.values(), indexing="ij"), axis=-1).reshape(-1, len(grid))
    return [dict(zip(grid, point.tolist(), strict=True)) for point in points]


def _together(parameters: dict[str, float], scores: Sequence[Score], worths: Sequence[Worth]) -> Combination:
    def middle(values: Sequence[float]) -> float:
        known = [value for value in values if math.isfinite(value)]
        return float(np.median(known)) if known else math.nan

    return Combination(
        parameters=parameters,
        likelihood=sum(worth.stop * one.stop.likelihood for one, worth in zip(scores, worths, strict=True)),
        nis_flight=middle([one.flight.nis for one in scores]),
        nis_stop=middle([one.stop.nis for one in scores]),
        x_to_smoother_mm=1e3 * middle([one.x_to_smoother_m for one in scores]),
        x_to_truth_mm=1e3 * middle([one.x_to_truth_m for one in scores]),
        v_to_truth_m_s=middle([one.v_to_truth_m_s for one in scores]),
        nees=middle([one.nees for one in scores]),
    )


def scored(
    sources: Sequence[Source],
    combinations: Sequence[dict[str, float]],
    progress: Counted,
    workers: int | None = None,
) -> tuple[list[Combination], list[Worth]]:
    """Replay all logs with all combinations, on all cores: results by combination, worths by log."""
    found: dict[int, tuple[Worth, list[Score]]] = {}
    count = min(workers or os.cpu_count() or 1, len(sources))
    with running(partial(_weighed, combinations), count) as run:
        for number, result in run(sources):
            found[number] = result
            progress(len(found), len(sources))
    worths, scores = zip(*(found[number] for number in range(len(sources))), strict=True)
    return [
        _together(parameters, [mine[place] for mine in scores], worths)
        for place, parameters in enumerate(combinations)
    ], list(worths)


def _weighed(combinations: Sequence[dict[str, float]], source: Source) -> tuple[Worth, list[Score]]:
    """Replay one log with all combinations, in a worker process."""
    return weigh(source), score(source, combinations)


def profile(points: Sequence[Combination], name: str) -> dict[float, float]:
    """The profile likelihood: for each value of a parameter, the best over the other parameters."""
    best: dict[float, float] = {}
    for point in points:
        value = point.parameters[name]
        best[value] = max(best.get(value, -math.inf), point.likelihood)
    return best


def tune_estimator(
    logs: Sequence[Path] = (),
    modules: int = MODULES,
    seconds: float = SECONDS,
    seed: int = TUNING_SEED,
    fresh_seed: int = FRESH_SEED,
    fresh_trials: int = FRESH_TRIALS,
    grid: dict[str, tuple[float, ...]] | None = None,
    progress: Counted = lambda *_: None,
    workers: int | None = None,
) -> tuple[Tuning, list[Combination]]:
    """The most likely combination from logs, or from sampled modules' logs; judged on fresh modules."""
    refuse_same_seeds(seed, fresh_seed)
    for path in logs:
        if not path.exists():
            raise BadInputError(f"{path} is not there; give a run folder or a candump log")
    sources = [Source(str(path), 0, 0, 0.0) for path in logs] or [
        Source("", seed, number, seconds) for number in range(modules)
    ]
    combinations = combinations_of(grid or GRID)
    here = {name: DEFAULTS[name] for name in (grid or GRID)}
    points, worths = scored(sources, [*combinations, here], progress, workers)
    points, default = points[:-1], points[-1]
    consistent = [one for one in points if one.nis_stop <= LARGEST_NIS] or points
    best = max(consistent, key=lambda one: one.likelihood)
    parameters: dict[str, Value] = {}
    for name in grid or GRID:
        near = [value for value, one in profile(consistent, name).items() if one > best.likelihood - NEAR]
        parameters[name] = tuned(name, best.parameters[name], min(near), max(near))
    noises = [one.noise_m_s2 for one in worths]
    parameters[FLOOR] = tuned(FLOOR, float(np.median(noises)), min(noises), max(noises))
    values = {name: value.value for name, value in parameters.items()}
    merits = {
        "log_likelihood": Merit(best.likelihood, "1"),
        "likeliest_nis_stop": Merit(max(points, key=lambda one: one.likelihood).nis_stop, "1"),
        "log_likelihood_over_default": Merit(best.likelihood - default.likelihood, "1"),
        "witnesses_in_flight": Merit(sum(one.flight for one in worths), "1"),
        "witnesses_at_the_stop": Merit(sum(one.stop for one in worths), "1"),
        "nis_flight": Merit(best.nis_flight, "1"),
        "nis_stop": Merit(best.nis_stop, "1"),
        "default_nis_flight": Merit(default.nis_flight, "1"),
        "default_nis_stop": Merit(default.nis_stop, "1"),
        "white_flight": Merit(float(np.nanmedian([one.white_flight for one in worths])), "1"),
        "x_to_smoother": Merit(best.x_to_smoother_mm, "mm"),
    }
    if math.isfinite(best.nees):
        merits |= {
            "nees": Merit(best.nees, "1"),
            "x_to_truth": Merit(best.x_to_truth_mm, "mm"),
            "v_to_truth": Merit(best.v_to_truth_m_s, "m/s"),
            "default_x_to_truth": Merit(default.x_to_truth_mm, "mm"),
            "default_v_to_truth": Merit(default.v_to_truth_m_s, "m/s"),
        }
    warnings = _warnings(parameters, worths, grid or GRID)
    if not math.isfinite(best.nis_stop):
        warnings.append("no touch-down in the logs: Q and R stay as they are")
        parameters = {FLOOR: parameters[FLOOR]}
        values = {FLOOR: values[FLOOR]}
    if fresh_trials:
        judged = run_candidates(
            "estimate", [values, {}, NAIVE], fresh_seed, fresh_trials, lambda *_: None, workers
        )
        for prefix, outcomes in zip(("fresh_", "fresh_default_", "fresh_naive_"), judged, strict=True):
            for name, unit in (("x_rmse", "mm"), ("v_rmse", "m/s")):
                some = [one.metrics[name] for one in outcomes if one.eligible]
                merits[f"{prefix}{name}"] = Merit(float(np.median(some)), unit)
    what = ", ".join(str(path) for path in logs) or f"{modules} sampled modules, {seconds:g} s each"
    tuning = Tuning(
        command="estimator",
        source=f"{what}; judged on seed {fresh_seed}" if fresh_trials else what,
        seed=None if logs else seed,
        range_is="values whose likelihood, whatever the others, does not differ significantly from the best",
        parameters=parameters,
        figures_of_merit=merits,
        warnings=tuple(warnings),
    )
    return tuning, points


def _warnings(
    parameters: dict[str, Value], worths: Sequence[Worth], grid: dict[str, tuple[float, ...]]
) -> list[str]:
    """The parameters that the logs cannot identify."""
    found = []
    for name, tried in grid.items():
        value = parameters[name]
        if value.low == tried[0] and value.high == tried[-1]:
            found.append(f"{name}: the logs cannot identify it, all values tried are as likely")
        elif value.value in (tried[0], tried[-1]):
            found.append(f"{name}: the most likely value lies at the end of those tried")
    if sum(one.stop for one in worths) < 5.0:
        found.append(
            "the logs inform about the stop as fewer than five touch-downs would; use logs of more modules"
        )
    return found
