"""Sobol points first, then differential evolution (scipy) and CMA-ES (cma) on the smallest margins.

All methods share the Sobol points of the start and have the same number of runs. An optimiser minimises the
margin of one check of one scenario at a time; every chosen check of every run is looked at, and the first one
that is broken ends the method.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import cma
import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from plant_sim.arrays import FloatArray
from tools.falsify.evaluations import Evaluations
from tools.falsify.objective import Result
from tools.falsify.space import Space

START_SHARE, MOST_START, TURN = 0.25, 64, 8
"""Share of the runs that are Sobol points before an optimiser begins, their largest number a scenario, and
how many of them a scenario has in turn."""
TARGETS = 8
"""Most checks on which an optimiser spends its runs."""
VARIES = 1e-6
"""Smallest range of a margin over the start for a check to give a direction."""
UNJUDGED = 2.0
"""Score of a run that is not judged: worse than any margin."""
POPULATION = 8, 16
"""Smallest and largest population of the differential evolution."""
SIGMA, CONVERGED, EDGE = 0.25, 1e-3, 0.01
"""First standard deviation of CMA-ES as a share of each range, range of scores and places at which it has
converged, and least distance of its begin from the ends of the ranges."""


class EndedError(Exception):
    """The runs of a method are spent, or it has found a counterexample."""


class Best(NamedTuple):
    """The run with the smallest margin: its scenario, values and result, and the check's place."""

    margin: float
    space: Space
    values: tuple[Any, ...]
    check: int

    @property
    def name(self) -> str:
        """The check's name."""
        return str(self.space.checks[self.check].name)


class Hunt:
    """The runs of one method: counted once each, and ended by a limit or the first counterexample."""

    def __init__(self, method: str, evaluations: Evaluations, budget: int) -> None:
        self.method, self.budget, self.limit = method, budget, budget
        self.best: Best | None = None
        self.found_after: int | None = None
        self._evaluations = evaluations
        self._seen: set[tuple[str, tuple[Any, ...]]] = set()

    @property
    def runs(self) -> int:
        """The number of different runs so far."""
        return len(self._seen)

    def results(self, space: Space, places: Iterable[FloatArray]) -> list[Result]:
        """The results at places of the unit cube, as many as the limit allows; EndedError at the end."""
        values = [space.values(place.tolist()) for place in places]
        new = [one for one in dict.fromkeys(values) if (space.name, one) not in self._seen]
        allowed = {*new[: max(self.limit - self.runs, 0)]}
        kept = [one for one in values if one in allowed or (space.name, one) in self._seen]
        found = self._evaluations.results(space, kept, self.method)
        for one, result in zip(kept, found, strict=True):
            self._note(space, one, result)
        if self.found_after is not None or len(kept) < len(values):
            raise EndedError
        return found

    def _note(self, space: Space, values: tuple[Any, ...], result: Result) -> None:
        if (space.name, values) in self._seen:
            return
        self._seen.add((space.name, values))
        if result.margin is not None and (self.best is None or result.margin < self.best.margin):
            self.best = Best(result.margin, space, values, result.worst)
            if result.margin < 0.0 and self.found_after is None:
                self.found_after = self.runs


class Start(NamedTuple):
    """The Sobol points of a scenario, shape (points, dimensions), and their results."""

    space: Space
    places: FloatArray
    results: list[Result]


class Target(NamedTuple):
    """A check of a scenario whose margin is minimised, from the places of the start, the best first."""

    space: Space
    check: int
    places: FloatArray


def sobol(space: Space, count: int, seed: int) -> FloatArray:
    """The first points of a scrambled Sobol sequence in the unit cube, shape (count, dimensions)."""
    sequence = qmc.Sobol(len(space.dimensions), rng=np.random.default_rng(seed))
    points: FloatArray = sequence.random_base2(max(math.ceil(math.log2(count)), 0))[:count]
    return points


def start_of(hunt: Hunt, spaces: Sequence[Space], seed: int) -> list[Start]:
    """Run the Sobol points of the start, some of each scenario by turns; EndedError at a counterexample."""
    count = max(min(int(START_SHARE * hunt.budget / len(spaces)), MOST_START), 1)
    starts = [Start(space, sobol(space, count, seed), []) for space in spaces]
    for begin in range(0, count, TURN):
        for space, places, results in starts:
            results.extend(hunt.results(space, places[begin : begin + TURN]))
    return starts


def score(result: Result, check: int) -> float:
    """A check's margin as a score to be minimised; without direction 1, like a wide margin."""
    if result.why:
        return UNJUDGED
    margin = result.margins[check]
    return 1.0 if margin is None else margin


def has_ties(margins: FloatArray) -> bool:
    """Whether two of the smaller half of the margins are equal."""
    smaller = np.sort(margins)[: (len(margins) + 1) // 2]
    return len(np.unique(smaller)) < len(smaller)


def targets_of(starts: Sequence[Start]) -> list[Target]:
    """The checks that are the fewest of their ranges from broken, the nearest first, each in one scenario.

    A range: from a check's median to its smallest margin. A limit that each run just keeps has a small margin
    but no direction, nor has a count, of which several runs share a small margin.
    """
    found: dict[str, tuple[float, Target]] = {}
    for start in starts:
        for check, one in enumerate(start.space.checks):
            scores = np.array([score(result, check) for result in start.results])
            judged = scores[scores < UNJUDGED]
            lowest = float(judged.min(initial=UNJUDGED))
            if len(judged) == 0 or np.ptp(judged) < VARIES or has_ties(judged):
                continue
            ranges = lowest / max(float(np.median(judged)) - lowest, VARIES)
            if one.name not in found or ranges < found[one.name][0]:
                target = Target(start.space, check, start.places[np.argsort(scores, kind="stable")])
                found[one.name] = ranges, target
    return [target for _, target in sorted(found.values(), key=lambda one: one[0])[:TARGETS]]


def no_score(_: Any) -> float:
    """Replaces the function of one place: `workers` has the scores of a whole generation."""
    return 0.0


def evolve(hunt: Hunt, target: Target, seed: int) -> None:
    """Minimise by scipy's differential evolution; the best points of the start are its first population."""

    def scores(_: Any, places: Any) -> list[float]:
        found = hunt.results(target.space, [np.asarray(place) for place in places])
        return [score(result, target.check) for result in found]

    least, most = POPULATION
    population = target.places[:most]
    if len(population) < least:
        population = np.concatenate([population, sobol(target.space, least, seed + 1)])
    differential_evolution(
        no_score,
        Bounds(*np.array([[0.0], [1.0]]).repeat(len(target.space.dimensions), axis=1)),
        init=population,
        maxiter=hunt.budget,
        tol=0.0,
        polish=False,
        updating="deferred",
        workers=scores,
        rng=np.random.default_rng(seed),
    )


def adapt(hunt: Hunt, target: Target, seed: int) -> None:
    """Minimise by CMA-ES with restarts (BIPOP), from the points of the start, the best first."""

    def scores(places: Any) -> list[float]:
        found = hunt.results(target.space, [np.asarray(place) for place in places])
        return [score(result, target.check) for result in found]

    begins = iter(np.clip(np.tile(target.places, (2, 1)), EDGE, 1.0 - EDGE))
    options = {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "tolfun": CONVERGED, "tolx": CONVERGED}
    cma.fmin2(
        None,
        lambda: next(begins),
        SIGMA,
        options,
        restarts=len(target.places),
        bipop=True,
        parallel_objective=scores,
    )


OPTIMISERS: dict[str, Callable[[Hunt, Target, int], None]] = {
    "differential evolution": evolve,
    "CMA-ES": adapt,
}
BASELINE = "Sobol"


def search(spaces: Sequence[Space], budget: int, seed: int, evaluations: Evaluations) -> list[Hunt]:
    """Search with the baseline and each optimiser, `budget` runs each; the first is the baseline."""
    baseline = Hunt(BASELINE, evaluations, budget)
    try:
        start_of(baseline, spaces, seed)
        for space in spaces:
            baseline.results(space, sobol(space, max(budget // len(spaces), 1), seed))
    except EndedError:
        pass
    hunts = [baseline]
    for method, optimise in OPTIMISERS.items():
        hunts.append(hunt := Hunt(method, evaluations, budget))
        try:
            targets = targets_of(start_of(hunt, spaces, seed))
        except EndedError:
            continue
        for number, target in enumerate(targets):
            hunt.limit = hunt.runs + (budget - hunt.runs) // (len(targets) - number)
            try:
                optimise(hunt, target, seed)
            except EndedError:
                if hunt.found_after is not None:
                    break
    return hunts


def most_important(values: FloatArray, margins: FloatArray) -> list[int]:
    """The two dimensions of which the margin is most a function, by Chatterjee's rank correlation.

    `values`: shape (runs, keys).
    """
    from scipy.stats import chatterjeexi

    varied = [k for k in range(values.shape[1]) if np.ptp(values[:, k]) > 0.0]
    ranks = {k: float(chatterjeexi(values[:, k], margins).statistic) for k in varied}
    return sorted(ranks, key=lambda k: -ranks[k])[:2]
