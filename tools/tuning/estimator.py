"""Q and R of the firmware's estimator from logs, by the likelihood of its innovations.

Each log is replayed through the estimator (`replay`) with every combination of three parameters: the process
noise of the velocity (Q), the correlation time of the model's error, within which N readings count as one
(R = N σ²), and the standard deviation of the stop's position (R at a touch-down). The criterion is the
innovation at a touch-down, where the stop measures the position independently of the accelerometer. Its
log-likelihood is summed over logs, weighted with the effective number of touch-downs: the innovations of a
wrong model are correlated (Varin, Reid & Firth 2011, 4.1). The number follows from their autocorrelation
about 0; a constant series counts as one value.

The innovation in free flight is no criterion: the reading that corrects the state has also propagated it, so
that the likelihood is largest for a filter that follows the model's errors. On sampled modules it would
choose parameters with three times the error of velocity. The touch-downs, without the truth, choose
parameters within 5 % of the least error of position. A limit of NIS excludes combinations whose variance is
too small.

The sensor's own noise, a lower limit of the σ² that the filter learns, follows from the second differences of
the readings. NIS is reported too.
"""

import math
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import correlate

from firmware_py.shell.parameters import BY_NAME, DEFAULTS
from hil.scenario.files import apply_differences
from hil.scenario.parameter_file import nest
from plant_sim.arrays import FloatArray
from tools.campaign.campaign import Cell
from tools.campaign.modules import module_cell
from tools.campaign.sampling import MISMATCH, Sampled, sample
from tools.jobs import results
from tools.output import BadInputError
from tools.progress import Progress
from tools.tuning.candidates import SAMPLING, Sampling, points_of, run_candidates
from tools.tuning.recordings.readings import Ticks
from tools.tuning.result import Merit, Tuning, Value, make_value

NOISE, MEMORY, STOP = "estimator.velocity_noise_m_s", "estimator.model_memory_s", "estimator.stop_std_m"
FLOOR = "estimator.model_std_m_s2"
GRID: dict[str, tuple[float, ...]] = {
    NOISE: (1e-5, 3e-5, 1e-4, 3e-4, 1e-3),
    MEMORY: (0.1, 0.3, 1.0, 3.0, 10.0),
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
NAIVE = {MEMORY: 0.1, "estimator.initial_model_std_m_s2": 0.016, "estimator.largest_model_std_m_s2": 0.016}
"""The textbook's choice: R is the sensor's noise, and as many readings as is permitted are independent."""

HIGHEST_NIS = 25.0
"""Limit of a normalised square, (5 σ)², so that one unrecognised impact does not dominate the likelihood."""
LEAST_CORRELATION = 0.05


class Log(NamedTuple):
    """The nominal parameters of a log's run, and the sensors' frames."""

    nominal: dict[str, Any]
    ticks: Ticks


class Replayed(NamedTuple):
    """A log: means over its innovations for each combination, shape (n,), and what they are worth.

    `likelihood`: of the innovations at the stop; `stop`: their effective number; `noise_m_s2`: the sensor's
    own noise.
    """

    likelihood: FloatArray
    nis_flight: FloatArray
    nis_stop: FloatArray
    stop: float
    noise_m_s2: float


@dataclass(frozen=True)
class Combination:
    """A combination of parameters and its results over all logs."""

    parameters: dict[str, float]
    likelihood: float
    nis_flight: float
    nis_stop: float


# --- innovations --------------------------------------------------------------------------------------


def mean_likelihood(innovation: FloatArray, variance: FloatArray) -> tuple[float, float]:
    """The means of ln p = −½ (ln 2πS + ν²/S) and of ν²/S, over innovations ν with the variances S."""
    if len(innovation) == 0:
        return 0.0, float("nan")
    squares = innovation**2 / variance
    likelihood = -0.5 * (np.log(2.0 * np.pi * variance) + np.minimum(squares, HIGHEST_NIS))
    return float(np.mean(likelihood)), float(np.mean(squares))


def worth(series: FloatArray) -> float:
    """The effective number of values: n / (1 + 2 Σρ), summed up to the first ρ below LEAST_CORRELATION.

    ρ is the autocorrelation about 0.
    """
    n = len(series)
    if n < 3 or not np.any(series):
        return float(min(n, 1))
    lagged = correlate(series, series)[n - 1 :]
    rho = lagged[1:] / lagged[0]
    ends = np.flatnonzero(rho < LEAST_CORRELATION)
    last = int(ends[0]) if len(ends) else len(rho)
    return float(n / (1.0 + 2.0 * np.sum(rho[:last])))


# --- in a process that compiles the firmware ----------------------------------------------------------


def read_log(path: Path) -> Log:
    """The log of a run folder or candump file."""
    from tools.tuning.identification.identify import nominal_of
    from tools.tuning.recordings.readings import read_ticks

    values = nominal_of(path)
    changed = {name: value for name, value in values.items() if value != DEFAULTS[name]}
    return Log(nest(changed), read_ticks(path, values["control.tick_s"]))


def sample_module(seed: int, number: int) -> tuple[Cell, Sampled]:
    """The condition and the truth of the sampled module with this number."""
    law, ratio = CONDITIONS[number % len(CONDITIONS)]
    cell = module_cell(law, ratio)
    return cell, sample(cell.scene, MISMATCH, seed, number)


def record_log(seed: int, number: int, seconds: float) -> Log:
    """The log of a sampled module."""
    from tools.tuning.recordings.recorded import read_received, record

    cell, sampled = sample_module(seed, number)
    return Log(deepcopy(dict(cell.firmware)), read_received(record(cell, sampled, seconds)))


def course_of(log: Log, parameters: dict[str, float]) -> FloatArray:
    """The estimator's history with these parameters, without its beginning: the columns of `replay`."""
    from firmware_py.shell.parameters import config_from
    from tools.tuning.recordings.replay import replay

    firmware = apply_differences(log.nominal, nest(parameters))
    begin = round(SETTLING_SHARE * len(log.ticks.low_m_s2))
    return replay(config_from(firmware), log.ticks)[begin:]


def replay_log(combinations: Sequence[dict[str, float]], source: Callable[[], Log]) -> Replayed:
    """Replay a log with all combinations; the effective number is that of the run's own parameters."""
    from tools.tuning.recordings import replay

    log = source()

    def innovations(parameters: dict[str, float]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Innovations and their variances, in flight and at the stop."""
        course = course_of(log, parameters)
        flying, stop = course[course[:, replay.FLYING] > 0.0], course[course[:, replay.AT_STOP] > 0.0]
        return (
            flying[:, replay.INNOVATION],
            flying[:, replay.INNOVATION_STD] ** 2,
            stop[:, replay.STOP_INNOVATION],
            stop[:, replay.STOP_VARIANCE],
        )

    *_, nu, nu_variance = innovations({})
    rows = []
    for parameters in combinations:
        found = innovations(parameters)
        (_, in_flight), (likelihood, at_stop) = mean_likelihood(*found[:2]), mean_likelihood(*found[2:])
        rows.append((likelihood, in_flight, at_stop))
    # Second differences of white noise have 6 times its variance; median |x| of a normal is 0.6745 σ.
    bends = np.abs(np.diff(log.ticks.low_m_s2, 2))
    noise_m_s2 = float(np.nanmedian(bends)) / 0.6745 / math.sqrt(6.0)
    likelihood, nis_flight, nis_stop = np.array(rows).T
    return Replayed(likelihood, nis_flight, nis_stop, worth(nu / np.sqrt(nu_variance)), noise_m_s2)


# --- all logs -----------------------------------------------------------------------------------------


def replay_all(
    sources: Sequence[Callable[[], Log]],
    combinations: Sequence[dict[str, float]],
    progress: Progress,
    workers: int | None = None,
) -> tuple[list[Combination], list[Replayed]]:
    """Replay all logs with all combinations, on all cores: results by combination, and by log."""
    found: dict[int, Replayed] = {}
    for number, result in results(partial(replay_log, combinations), sources, workers):
        found[number] = result
        progress(len(found) / len(sources), "logs")
    logs = [found[number] for number in range(len(sources))]

    def middle(values: Sequence[float]) -> float:
        known = [value for value in values if math.isfinite(value)]
        return float(np.median(known)) if known else math.nan

    return [
        Combination(
            parameters=parameters,
            likelihood=float(sum(one.stop * one.likelihood[place] for one in logs)),
            nis_flight=middle([one.nis_flight[place] for one in logs]),
            nis_stop=middle([one.nis_stop[place] for one in logs]),
        )
        for place, parameters in enumerate(combinations)
    ], logs


def select_consistent(points: Sequence[Combination]) -> Sequence[Combination]:
    """The combinations whose variance at the stop is not too small; all if it is in every one."""
    return [one for one in points if one.nis_stop <= LARGEST_NIS] or points


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
    fresh_trials: int = FRESH_TRIALS,
    grid: dict[str, tuple[float, ...]] | None = None,
    sampling: Sampling = SAMPLING,
    progress: Progress = lambda *_: None,
) -> tuple[Tuning, list[Combination]]:
    """The most likely combination from logs, or from sampled modules' logs; judged on fresh modules."""
    for path in logs:
        if not path.exists():
            raise BadInputError(f"{path} is not there; give a run folder or a candump log")
    sources = [partial(read_log, path) for path in logs] or [
        partial(record_log, sampling.seed, number, seconds) for number in range(modules)
    ]
    combinations = points_of(grid or GRID)
    here = {name: DEFAULTS[name] for name in (grid or GRID)}
    points, by_log = replay_all(sources, [*combinations, here], progress, sampling.workers)
    points, default = points[:-1], points[-1]
    sound = select_consistent(points)
    best = max(sound, key=lambda one: one.likelihood)
    parameters: dict[str, Value] = {}
    for name in grid or GRID:
        near = [value for value, one in profile(sound, name).items() if one > best.likelihood - NEAR]
        parameters[name] = make_value(name, best.parameters[name], min(near), max(near))
    parameters[FLOOR] = value_of_floor([one.noise_m_s2 for one in by_log])
    values = {name: value.value for name, value in parameters.items()}
    merits = {
        "log_likelihood": Merit(best.likelihood, "1"),
        "likeliest_nis_stop": Merit(
            max(points, key=lambda one: one.likelihood).nis_stop,
            "1",
            "of the most likely combination, consistent or not",
        ),
        "log_likelihood_over_default": Merit(best.likelihood - default.likelihood, "1"),
        "witnesses_at_the_stop": Merit(
            sum(one.stop for one in by_log), "1", "independent innovations at the stop, in number"
        ),
        "nis_flight": Merit(best.nis_flight, "1", "normalised innovation squared in flight; 1 is consistent"),
        "nis_stop": Merit(best.nis_stop, "1"),
        "default_nis_flight": Merit(default.nis_flight, "1"),
        "default_nis_stop": Merit(default.nis_stop, "1"),
    }
    warnings = _warnings(parameters, by_log, grid or GRID)
    if not math.isfinite(best.nis_stop):
        warnings.append("no touch-down in the logs: Q and R stay as they are")
        parameters = {FLOOR: parameters[FLOOR]}
        values = {FLOOR: values[FLOOR]}
    if fresh_trials:
        judged = run_candidates(
            "estimate", [values, {}, NAIVE], sampling.fresh_seed, fresh_trials, workers=sampling.workers
        )
        for prefix, outcomes in zip(("fresh_", "fresh_default_", "fresh_naive_"), judged, strict=True):
            for name, unit in (("x_rmse", "mm"), ("v_rmse", "m/s")):
                some = [one.metrics[name] for one in outcomes if one.eligible]
                merits[f"{prefix}{name}"] = Merit(float(np.median(some)), unit)
    what = ", ".join(str(path) for path in logs) or f"{modules} sampled modules, {seconds:g} s each"
    tuning = Tuning(
        command="estimator",
        source=f"{what}; judged on seed {sampling.fresh_seed}" if fresh_trials else what,
        seed=None if logs else sampling.seed,
        range_is="values whose likelihood, whatever the others, does not differ significantly from the best",
        parameters=parameters,
        figures_of_merit=merits,
        warnings=tuple(warnings),
    )
    return tuning, points


def value_of_floor(noises_m_s2: Sequence[float]) -> Value:
    """The median noise of the logs; that of a quiet sensor is not below the parameter's bound."""
    permitted = [max(one, BY_NAME[FLOOR].low) for one in noises_m_s2]
    return make_value(FLOOR, float(np.median(permitted)), min(permitted), max(permitted))


def _warnings(
    parameters: dict[str, Value], logs: Sequence[Replayed], grid: dict[str, tuple[float, ...]]
) -> list[str]:
    """The parameters that the logs cannot identify."""
    found = []
    for name, tried in grid.items():
        value = parameters[name]
        if value.low == tried[0] and value.high == tried[-1]:
            found.append(f"{name}: the logs cannot identify it, all values tried are as likely")
        elif value.value in (tried[0], tried[-1]):
            found.append(f"{name}: the most likely value lies at the end of those tried")
    if sum(one.stop for one in logs) < 5.0:
        found.append(
            "the logs inform about the stop as fewer than five touch-downs would; use logs of more modules"
        )
    return found
