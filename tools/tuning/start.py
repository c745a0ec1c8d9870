"""Tuning of the soft start: the S-curve's rise and the ratio of its approach, on a grid of both, in lockstep.

The other parameters of start and hold loop, each alone at both ends of its range, made no significant
difference (docs/how-to/tune.md). Each point of the grid runs the start-up campaign on the same sampled
modules and starts. There are four criteria, the most important first: the share of starts that fail, the
hardest twentieth of impacts during the start relative to the steady ones, the time until 95 % are captured,
and the energy used. Points without a significant difference in a criterion count as equal in it
(`criteria`). The best point, the default and a naive start are judged on seeds that had no part in the
choice.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from plant_sim.arrays import FloatArray
from plant_sim.scene import load_scene, read_scene
from tools.campaign.campaign import Condition
from tools.campaign.module_campaigns import NO_IMPULSE
from tools.campaign.statistics import wilson
from tools.progress import Progress
from tools.study.branches.boundaries import margins
from tools.tuning.candidates import (
    SAMPLING,
    Candidate,
    Sampling,
    points_of,
    run_candidates,
)
from tools.tuning.criteria import (
    CAPTURE_S,
    ENERGY_J,
    FAILED,
    IMPACT,
    choose,
    find_differing,
    hardest,
    late,
    starts_of,
)
from tools.tuning.result import Merit, Tuning, make_value

RISE, APPROACH = "start.rise_s", "start.approach_ratio"
Grid = Mapping[str, Sequence[float]]
GRID: Grid = {RISE: (2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0), APPROACH: (0.6, 0.7, 0.8, 0.9)}
"""The values of each parameter; a finer step makes no significant difference."""
DEFAULT = {name: DEFAULTS[name] for name in GRID}
NAIVE = {RISE: 0.5, "start.again_s": 0.5}
"""A ramp to the speed as fast as the motor can follow."""
CONDITIONS: tuple[Condition, ...] = (
    (("viscous",), (1.1, 1.2, 1.3, 1.35), NO_IMPULSE),
    (("coulomb", "stribeck"), (1.1, 1.2), NO_IMPULSE),
)
"""The conditions of the campaign in which an impact attractor exists."""
TRIALS = 320
"""Forty for each friction law and ratio: enough to distinguish impacts that are 10 % harder."""
FRESH_TRIALS = 1200
"""Enough to distinguish impacts that are 3 % harder; a quarter hardly suffices for 5 %."""
BEST_PLACE, DEFAULT_PLACE = 0, 1
"""Indices among the candidates that are judged on fresh trials."""
SCENE = "table1-viscous"
"""The scene of the margins: the nominal module with a rigid stop, in the impact regime at r = 1.3."""
MARGINS = ("ratio", "b", "gap", "amplitude", "restitution")
"""The parameters whose distance to the fold is reported, each changed alone."""


@dataclass(frozen=True)
class Ramp:
    """A candidate and its results; `overshoot` is the mean of the hardest twentieth of impacts."""

    parameters: dict[str, float]
    eligible: int
    failures: int
    overshoot: float
    largest: float
    capture_p50_s: float
    capture_p95_s: float
    energy_p50_j: float

    @property
    def success_low(self) -> float:
        """Wilson's lower bound of the share that succeeds."""
        return wilson(self.eligible - self.failures, self.eligible).low


def ramp(parameters: Mapping[str, float], starts: FloatArray) -> Ramp:
    """The results of a candidate's starts."""

    def of(figure: Callable[[FloatArray], Any], row: int) -> float:
        values = starts[row][np.isfinite(starts[row])]
        return float(figure(values)) if len(values) else math.inf

    return Ramp(
        parameters=dict(parameters),
        eligible=starts.shape[1],
        failures=round(float(np.sum(starts[FAILED]))),
        overshoot=of(hardest, IMPACT),
        largest=of(np.max, IMPACT),
        capture_p50_s=of(np.median, CAPTURE_S),
        capture_p95_s=of(late, CAPTURE_S),
        energy_p50_j=of(np.median, ENERGY_J),
    )


def tune_start(
    trials: int = TRIALS,
    fresh_trials: int = FRESH_TRIALS,
    sampling: Sampling = SAMPLING,
    progress: Progress = lambda *_: None,
    grid: Grid = GRID,
) -> tuple[Tuning, list[Ramp]]:
    """The best point of the grid, and the results of all points with `trials` each."""
    points = points_of(grid)

    def run(some: Sequence[Candidate], its_seed: int, its_trials: int) -> list[FloatArray]:
        workers = sampling.workers
        found = run_candidates("start-up", some, its_seed, its_trials, progress, workers, CONDITIONS)
        return [starts_of(outcomes) for outcomes in found]

    starts = run(points, sampling.seed, trials)
    choice = choose(starts)
    best = points[choice.best]
    everyone = [best, DEFAULT, {**DEFAULT, **NAIVE}]
    fresh = run(everyone, sampling.fresh_seed, fresh_trials)
    after, before, naive = (ramp(one, some) for one, some in zip(everyone, fresh, strict=True))
    as_good = choose(fresh[:2]).alike
    alone = {name: find_equivalent(name, points, starts, choice.best) for name in grid}
    tuning = Tuning(
        command="start",
        source=(
            f"campaign start-up, {trials} trials of seed {sampling.seed} for each of {len(points)} points; "
            f"judged on {fresh_trials} of seed {sampling.fresh_seed}"
        ),
        seed=sampling.seed,
        range_is="values that, each alone, make no significant difference",
        parameters={name: make_value(name, best[name], min(alone[name]), max(alone[name])) for name in grid},
        figures_of_merit={
            **merits("", after),
            **merits("default_", before),
            **merits("naive_", naive),
            "candidates": Merit(float(len(points)), "1", "points of the grid that were tried"),
            "candidates_alike": Merit(
                float(len(choice.alike)), "1", "of them, not significantly worse than the best"
            ),
            **fold_margins(),
        },
        warnings=tuple(_warnings(as_good, after)),
        default_as_good=DEFAULT_PLACE in as_good,
    )
    return tuning, [ramp(one, some) for one, some in zip(points, starts, strict=True)]


def find_equivalent(
    name: str, points: Sequence[Mapping[str, float]], starts: Sequence[FloatArray], best: int
) -> list[float]:
    """The values of a parameter that make no significant difference, the others as at the best point."""
    return [
        one[name]
        for one, some in zip(points, starts, strict=True)
        if {**one, name: points[best][name]} == points[best] and not find_differing(some, starts[best])
    ]


def _warnings(as_good: Sequence[int], fresh: Ramp) -> Iterator[str]:
    """Warnings: a default that is better, and starts that fail."""
    if BEST_PLACE not in as_good:
        yield "on fresh trials the default is better: keep it, or choose with more trials"
    if fresh.failures:
        yield f"{fresh.failures} of {fresh.eligible} fresh starts fail"


def fold_margins() -> dict[str, Merit]:
    """How far the operating point, to which every start leads, is from the fold where impacts end."""
    return {
        f"{SCENE}_fold_{margin.parameter}": Merit(margin.distance, margin.unit or "1")
        for margin in margins(load_scene(read_scene(SCENE)), MARGINS)
        if margin.kind == "fold"
    }


def merits(prefix: str, one: Ramp) -> dict[str, Merit]:
    """The results of a candidate as figures of merit; each name begins with `prefix`."""
    return {
        f"{prefix}eligible": Merit(float(one.eligible), "1"),
        f"{prefix}failures": Merit(float(one.failures), "1"),
        f"{prefix}success_low": Merit(one.success_low, "1"),
        f"{prefix}hardest_overshoot": Merit(one.overshoot, "1"),
        f"{prefix}largest_overshoot": Merit(one.largest, "1"),
        f"{prefix}capture_p50": Merit(one.capture_p50_s, "s"),
        f"{prefix}capture_p95": Merit(one.capture_p95_s, "s"),
        f"{prefix}energy_p50": Merit(one.energy_p50_j, "J"),
    }
