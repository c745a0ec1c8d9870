"""Compares the firmware's defaults with the results of the tuning commands and with naive values.

Each tuning runs with the default options of its command. A default passes if it lies within a stated
tolerance of the tuned value; for some parameters also if the tuning does not significantly distinguish the
two. The defaults of the start pass together, if fresh trials do not show them to be significantly worse.
Defaults and naive values are compared on sampled modules that had no part in any choice.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from hil.bench.lockstep import in_lockstep
from hil.scenario.scenario import load_scenario
from tools.campaign.results import counts_of, values_of
from tools.progress import Progress, counting
from tools.tuning import detector, estimator, start, trials
from tools.tuning.candidates import FRESH_SEED, run_candidates
from tools.tuning.identification.identify import tune_identify
from tools.tuning.result import Merit, Tuning
from tools.tuning.speed import tune_speed

RECORDED = "soft-start-multistable"
"""A scenario whose module has the firmware's default parameters."""
RECORDED_SEED = 20_261
HOLD_RATIO = (("viscous",), (1.3,), (0.0,))
NO_FEED_FORWARD = {"speed.load_share": 0.0}
TIMID_FLOOR = {detector.PARAMETER: 0.1}
"""Seven times the sensor's noise, a common choice of a threshold."""
LEAST_SQUARES = "least squares on the equations alone"
HASTY = "up to speed in 0.5 s"
TIMID = "a floor of seven times the noise"
PLAIN = "R is the sensor's noise"


class Tolerance(NamedTuple):
    """Largest deviation of a default from the tuned value; `in_range` also accepts the tuned range."""

    factor: float = 1.0
    difference: float = 0.0
    in_range: bool = False

    def holds(self, default: float, value: float, low: float, high: float) -> bool:
        """Whether a default is within the tolerance; a relative rounding error of 1e-6 is ignored."""
        slack = 1e-6 * abs(value)
        near = (
            min(value / self.factor, value - self.difference) - slack
            <= default
            <= max(value * self.factor, value + self.difference) + slack
        )
        return near or (self.in_range and low - slack <= default <= high + slack)

    def __str__(self) -> str:
        said = []
        if self.factor > 1.02:
            said.append(f"× or ÷ {self.factor:g}")
        elif self.factor > 1.0:
            said.append(f"± {100.0 * (self.factor - 1.0):.2g} %")
        if self.difference:
            said.append(f"± {self.difference:g}")
        if self.in_range:
            said.append("or as good")
        return " ".join(said)


EXACT = Tolerance(1.005)
GRID_STEP = Tolerance(3.4)
TOLERANCES: dict[str, Tolerance] = {
    "speed.gain_p_n_m_s": EXACT,
    "speed.gain_i_n_m": EXACT,
    "crank.bandwidth_rad_s": EXACT,
    "striker.spring_n_m": EXACT,
    "drive.amplitude_m": EXACT,
    "friction.b_n_s_m": Tolerance(1.05),
    "friction.mu": Tolerance(difference=1e-3),
    "stop.position_m": Tolerance(difference=1e-4),
    "stop.restitution": Tolerance(difference=0.01),
    "stop.contact_s": Tolerance(1.03),
    detector.PARAMETER: Tolerance(2.0, in_range=True),
    estimator.NOISE: GRID_STEP,
    estimator.MEMORY: GRID_STEP,
    estimator.STOP: GRID_STEP,
    estimator.FLOOR: Tolerance(1.15),
}
"""The goals of identification; for estimator and detector, one step between the values that are tried."""
TOGETHER = "together as good"
"""Tolerance of a tuning that compares performance: its parameters can compensate for each other."""


@dataclass(frozen=True)
class Row:
    """A parameter's default beside the value that a command has tuned."""

    parameter: str
    command: str
    unit: str
    default: float
    tuned: float
    low: float
    high: float
    tolerance: str
    passed: bool


@dataclass(frozen=True)
class Margin:
    """A figure with the default and with a naive value, on fresh trials; smaller is better."""

    command: str
    what: str
    unit: str
    default: float
    naive: float
    naive_is: str


@dataclass(frozen=True)
class Effort:
    """Arguments that set the extent of each tuning, e.g. its trials; by default those of its command."""

    detector: Mapping[str, Any] = field(default_factory=dict)
    estimator: Mapping[str, Any] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)
    hold_trials: int = 24
    identify_trials: int = 40


QUICK = Effort(
    detector={"trials": 11, "floors_m_s2": (0.4, 0.8, 1.5, 3.0, 6.0)},
    estimator={"modules": 8, "seconds": 30.0, "fresh_trials": 4},
    start={"candidates": 3, "trials": 12, "fresh_trials": 12},
    hold_trials=2,
    identify_trials=4,
)
"""Few trials: they test whether all tunings run and agree, with large statistical errors."""


def tunings(folder: Path, effort: Effort, progress: Progress, workers: int | None = None) -> list[Tuning]:
    """Run all tunings one after the other; `folder` receives the log to identify and the search's journal."""

    def shown(name: str) -> dict[str, Any]:
        return {"progress": lambda done, total: progress(done / max(total, 1), name), "workers": workers}

    progress(0.0, "speed")
    speed = tune_speed()[0]
    recorded = folder / "recorded"
    shutil.rmtree(recorded, ignore_errors=True)

    def noted(share: float, _: str) -> None:
        progress(share, "recording")

    run_dir, _ = in_lockstep(load_scenario(RECORDED), recorded, RECORDED_SEED, noted, "compiled")
    progress(0.0, "identify")
    identified = tune_identify(run_dir)[0]
    estimated = estimator.tune_estimator(**effort.estimator, **shown("estimator"))[0]
    detected = detector.tune_detector(**effort.detector, **shown("detector"))[0]
    started = start.tune_start(folder / "start.journal", **effort.start, **shown("start"))[0]
    return [speed, identified, estimated, detected, started]


def rows_of(found: Sequence[Tuning]) -> list[Row]:
    """Every tuned parameter beside its default."""
    rows = []
    for tuning in found:
        for name, value in tuning.parameters.items():
            if tuning.default_as_good is None:
                tolerance = str(TOLERANCES[name])
                passed = TOLERANCES[name].holds(DEFAULTS[name], value.value, value.low, value.high)
            else:
                tolerance, passed = TOGETHER, tuning.default_as_good
            numbers = (DEFAULTS[name], value.value, value.low, value.high)
            rows.append(Row(name, tuning.command, value.unit, *numbers, tolerance, passed))
    return rows


def margins_of(
    folder: Path, found: Sequence[Tuning], effort: Effort, progress: Progress, workers: int | None = None
) -> list[Margin]:
    """Compare the defaults with naive values on fresh trials, and the identification with least squares."""
    merits = {tuning.command: tuning.figures_of_merit for tuning in found}
    judged = [*_of_estimator(merits["estimator"]), *_of_start(merits["start"])]
    return [
        _of_speed(effort, progress, workers),
        _of_identify(folder, effort, progress, workers),
        _of_detector(effort, progress, workers),
        *judged,
    ]


def _of_speed(effort: Effort, progress: Progress, workers: int | None) -> Margin:
    both, noted = [{}, NO_FEED_FORWARD], counting(progress, "margin of speed")
    held = run_candidates("hold", both, FRESH_SEED, effort.hold_trials, noted, workers, (HOLD_RATIO,))
    default, naive = (float(np.median(values_of(outcomes).get("ripple", [np.nan]))) for outcomes in held)
    return Margin("speed", "crank's speed ripple in the hold", "%", default, naive, "no load fed forward")


def _of_identify(folder: Path, effort: Effort, progress: Progress, workers: int | None) -> Margin:
    identified = trials.run_trials(
        effort.identify_trials,
        folder / "identify-trials.jsonl",
        progress=counting(progress, "margin of identify"),
        workers=workers,
    )
    errors = (
        [abs(error) for errors in some if (error := errors.get("damping")) is not None]
        for some in ([one.errors for one in identified], [one.plain for one in identified])
    )
    tuned, plain = (100.0 * float(np.median(some)) for some in errors)
    return Margin("identify", "error of b from a minute, median", "%", tuned, plain, LEAST_SQUARES)


def _of_detector(effort: Effort, progress: Progress, workers: int | None) -> Margin:
    both, noted = [{}, TIMID_FLOOR], counting(progress, "margin of detector")
    count = effort.detector.get("trials", detector.TRIALS)
    detected = run_candidates("detect", both, FRESH_SEED, count, noted, workers)
    costs = []
    for outcomes in detected:
        counts = counts_of(outcomes)
        hours = sum(outcome.simulated_s for outcome in outcomes) / 3600.0
        costs.append((counts["misses"] + counts["false_alarms"]) / hours)
    return Margin("detector", "misses and false alarms", "1/h", costs[0], costs[1], TIMID)


def _of_estimator(merits: Mapping[str, Merit]) -> list[Margin]:
    """Margins of the estimator; an empty list if the tuning was not judged on fresh trials."""
    return [
        _of_merits("estimator", f"error of {name}, RMS", merits, "fresh_{}_" + f"{name}_rmse", PLAIN)
        for name in ("x", "v")
        if f"fresh_{name}_rmse" in merits
    ]


def _of_start(merits: Mapping[str, Merit]) -> list[Margin]:
    return [
        _of_merits("start", what, merits, "{}_" + name, HASTY)
        for what, name in (
            (f"starts that fail, of {merits['default_eligible'].value:g}", "failures"),
            ("hardest twentieth of impacts, steady ones = 1", "hardest_overshoot"),
            ("largest impact of all starts, steady ones = 1", "largest_overshoot"),
            ("until 95 % of starts have captured", "capture_p95"),
        )
    ]


def _of_merits(command: str, what: str, merits: Mapping[str, Merit], name: str, naive_is: str) -> Margin:
    """The margin between two figures of merit, whose names have `default` or `naive` in place of {}."""
    default, naive = (merits[name.format(which)] for which in ("default", "naive"))
    return Margin(command, what, default.unit, default.value, naive.value, naive_is)


def check_defaults(
    folder: Path, effort: Effort = Effort(), progress: Progress = lambda *_: None, workers: int | None = None
) -> tuple[dict[str, Any], list[Tuning]]:
    """The JSON object of `tune check`, and the tunings."""
    found = tunings(folder, effort, progress, workers)
    rows = rows_of(found)
    margins = margins_of(folder, found, effort, progress, workers)
    return {
        "command": "check",
        "parameters": [asdict(row) for row in rows],
        "margins": [asdict(margin) for margin in margins],
        "warnings": [f"{tuning.command}: {said}" for tuning in found for said in tuning.warnings],
        "passed": all(row.passed for row in rows),
        "out": str(folder),
    }, found
