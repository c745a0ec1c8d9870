"""Tuning of the soft start: S-curves, capture speed and hold loop, searched by Optuna in lockstep.

Candidates run the start-up campaign, all on the same sampled modules and starts. There are four criteria, the
most important first: the share of starts that fail, the hardest twentieth of impacts during the start
relative to the steady ones, the time until 95 % are captured, and the energy used. Candidates without a
significant difference in a criterion count as equal in it (`criteria`).

First the default runs with each parameter alone at both ends of its range. A parameter is free if neither end
makes a significant difference: it keeps its default, and a warning reports it. Optuna (Akiba et al., KDD
2019) searches the other parameters for all four criteria at once; the candidates that no other candidate
dominates are the Pareto front. The first few of them and the default run on more trials, and the best is
chosen criterion by criterion; then its neighbours are tried, until none is better. The winner, the default
and a naive start are judged on seeds that had no part in the choice.

A journal beside the parameter file holds the free parameters and the finished candidates, so that a command
that was killed can continue.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from hil.record import provenance
from plant_sim.arrays import FloatArray
from tools.campaign.campaigns import NO_IMPULSE
from tools.campaign.statistics import wilson
from tools.campaign.trial.cells import Condition
from tools.progress import Counted
from tools.tuning.candidates import (
    FRESH_SEED,
    TUNING_SEED,
    Candidate,
    processes_for,
    refuse_same_seeds,
    run_candidates,
)
from tools.tuning.criteria import (
    CAPTURE_S,
    ENERGY_J,
    FAILED,
    IMPACT,
    choose,
    differing,
    hardest,
    late,
    starts_of,
)
from tools.tuning.result import Merit, Tuning, tuned

if TYPE_CHECKING:
    import optuna

RISE, AGAIN, APPROACH = "start.rise_s", "start.again_s", "start.approach_ratio"
CAPTURE, FREE = "start.capture_ratio", "start.free_ratio"
HOLD_GAIN, HOLD_RATE = "hold.gain_phase", "hold.rate_1_s"
SPACE: dict[str, tuple[float, float, float]] = {
    RISE: (1.0, 8.0, 0.5),
    AGAIN: (0.5, 4.0, 0.5),
    APPROACH: (0.6, 0.9, 0.1),
    CAPTURE: (0.75, 0.95, 0.05),
    FREE: (1.2, 1.36, 0.04),
    HOLD_GAIN: (0.05, 0.45, 0.1),
    HOLD_RATE: (0.01, 0.06, 0.01),
}
"""Lowest value, highest value and step of each parameter; a finer step makes no significant difference."""
DEFAULT = {name: DEFAULTS[name] for name in SPACE}
NAIVE = {RISE: 0.5, AGAIN: 0.5}
"""A ramp to the speed as fast as the motor can follow."""
CONDITIONS: tuple[Condition, ...] = (
    (("viscous",), (1.1, 1.2, 1.3, 1.35), NO_IMPULSE),
    (("coulomb", "stribeck"), (1.1, 1.2), NO_IMPULSE),
)
"""The conditions of the campaign in which an impact attractor exists."""
CANDIDATES = 24
BATCH = 6
"""Number of candidates that Optuna suggests at a time; their trials run in parallel."""
TRIALS = 64
"""Eight for each friction law and ratio."""
SCREENING_TRIALS = 320
"""Enough to find the parameters without a significant effect."""
FRESH_TRIALS = 1200
"""Enough to distinguish impacts that are 3 % harder; a quarter hardly suffices for 5 %."""
FINALISTS = 5
"""Largest number of candidates from the Pareto front in the final, beside the default."""
ROUNDS = 6
"""Largest number of rounds of the final: the finalists, then neighbours of the best."""
BEST_PLACE, DEFAULT_PLACE = 0, 1
"""Indices among the candidates that are judged on fresh trials."""

DIGITS = 6
"""Decimals to which multiples of a step are rounded."""

Run = Callable[[Sequence[Candidate]], list[FloatArray]]
"""Runs candidates, all on the same trials; returns the table of starts of each."""


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
    on_front: bool = False

    @property
    def objectives(self) -> tuple[float, float, float, float]:
        """The figures to be minimised, in their order: failures, overshoot, time, energy."""
        return (self.failures / max(self.eligible, 1), self.overshoot, self.capture_p95_s, self.energy_p50_j)

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


def dominates(one: Ramp, other: Ramp) -> bool:
    """Whether `one` is as good as `other` or better in every criterion, and better in at least one."""
    pairs = list(zip(one.objectives, other.objectives, strict=True))
    return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)


def with_front(tried: Sequence[Ramp]) -> list[Ramp]:
    """All candidates, with those of the Pareto front marked."""
    return [replace(one, on_front=not any(dominates(other, one) for other in tried)) for one in tried]


# --- the search ---------------------------------------------------------------------------------------


def name_of_search(numbers: Sequence[int]) -> str:
    """Name of a search, from all that its results depend on: space, trials and seed, sources, packages."""
    return f"start-{provenance.key(SPACE, tuple(numbers))[:12]}"


def study_in(journal: Path, name: str, seed: int) -> "optuna.Study":
    """The search from the journal, or a new search that begins with the default."""
    import optuna
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    backend = JournalFileBackend(str(journal))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study = optuna.create_study(
            study_name=name,
            storage=optuna.storages.JournalStorage(backend),
            directions=["minimize"] * 4,
            load_if_exists=True,
        )
        study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials), multivariate=True)
    if all(one.parameters != DEFAULT for one in finished(study)):
        study.enqueue_trial(DEFAULT, skip_if_exists=False)
    return study


def asked(
    study: "optuna.Study", count: int, free: Sequence[str]
) -> list[tuple["optuna.Trial", dict[str, float]]]:
    """Let Optuna suggest `count` candidates of the search space; free parameters keep their defaults."""
    found = []
    for _ in range(count):
        trial = study.ask()
        values = {
            name: round(trial.suggest_float(name, low, high, step=step), DIGITS)
            for name, (low, high, step) in SPACE.items()
            if name not in free
        }
        found.append((trial, {**DEFAULT, **values}))
    return found


def finished(study: "optuna.Study") -> list[Ramp]:
    """The finished candidates in the journal; a candidate that a kill interrupted is left out."""
    return [Ramp(**trial.user_attrs["ramp"]) for trial in study.trials if trial.values is not None]


def searched(
    study: "optuna.Study",
    free: Sequence[str],
    candidates: int,
    run: Callable[[Sequence[Candidate], int], list[FloatArray]],
) -> list[Ramp]:
    """Let Optuna suggest candidates, run them and report their results, until `candidates` are finished.

    `run` runs candidates; its second argument is the number of candidates that are finished.
    """
    known = finished(study)
    while len(known) < candidates:
        batch = asked(study, min(BATCH, candidates - len(known)), free)
        found = run([values for _, values in batch], len(known))
        for (trial, values), some in zip(batch, found, strict=True):
            one = ramp(values, some)
            trial.set_user_attr("ramp", vars(one))
            study.tell(trial, [min(figure, 1e9) for figure in one.objectives])
        known = finished(study)
    return known


# --- the choice ---------------------------------------------------------------------------------------


class Final(NamedTuple):
    """The best finalist, the number not significantly worse, and the admissible values of each parameter."""

    best: dict[str, float]
    finalists: int
    alike: int
    alone: dict[str, list[float]]


def screened(run: Run) -> tuple[str, ...]:
    """The free parameters: neither end of their range alone makes a significant difference to the default."""
    ends = [(name, end) for name, (low, high, _) in SPACE.items() for end in (low, high)]
    default, *at_ends = run([DEFAULT, *({**DEFAULT, name: end} for name, end in ends)])
    moved = {name for (name, _), some in zip(ends, at_ends, strict=True) if differing(some, default)}
    return tuple(name for name in SPACE if name not in moved)


def final(tried: Sequence[Ramp], free: Sequence[str], run: Run) -> Final:
    """Run the default and the first of the front, then the best one's neighbours, until none is better."""
    front = sorted((one for one in tried if one.on_front), key=lambda one: one.objectives)
    finalists: list[dict[str, float]] = []
    starts: list[FloatArray] = []
    new = [DEFAULT, *[one.parameters for one in front if one.parameters != DEFAULT][:FINALISTS]]
    for _ in range(ROUNDS):
        finalists += new
        starts += run(new)
        choice = choose(starts)
        best = finalists[choice.best]
        new = [one for one in neighbours(best, free) if one not in finalists]
        if not new:
            break
    alone = {
        name: [
            one[name]
            for one, some in zip(finalists, starts, strict=True)
            if {**one, name: best[name]} == best and not differing(some, starts[choice.best])
        ]
        for name in SPACE
    }
    for name in free:
        alone[name] += SPACE[name][:2]
    return Final(best, len(finalists), len(choice.alike), alone)


def neighbours(one: Mapping[str, float], free: Sequence[str]) -> list[dict[str, float]]:
    """The candidates that differ from `one` by one step in one parameter that is not free."""
    return [
        {**one, name: round(value, DIGITS)}
        for name, (low, high, step) in SPACE.items()
        if name not in free
        for value in (one[name] - step, one[name] + step)
        if low <= round(value, DIGITS) <= high
    ]


def tune_start(
    journal: Path,
    candidates: int = CANDIDATES,
    trials: int = TRIALS,
    fresh_trials: int = FRESH_TRIALS,
    seed: int = TUNING_SEED,
    fresh_seed: int = FRESH_SEED,
    progress: Counted = lambda *_: None,
    workers: int | None = None,
) -> tuple[Tuning, list[Ramp]]:
    """The best start and all candidates; both the final and the judgement have `fresh_trials` trials."""
    final_seed, screening_trials = seed + 1, min(SCREENING_TRIALS, fresh_trials)
    refuse_same_seeds(final_seed, fresh_seed)
    study = study_in(journal, name_of_search([trials, fresh_trials, seed]), seed)

    with processes_for(workers) as processes:

        def judged(
            some: Sequence[Candidate], its_seed: int, its_trials: int, noted: Counted = progress
        ) -> list[FloatArray]:
            found = run_candidates(
                "start-up", some, its_seed, its_trials, noted, workers, CONDITIONS, processes
            )
            return [starts_of(outcomes) for outcomes in found]

        def suggested(some: Sequence[Candidate], known: int) -> list[FloatArray]:
            total = candidates * trials
            progress(known * trials, total)
            return judged(some, seed, trials, lambda done, _: progress(known * trials + done, total))

        if "free" not in study.user_attrs:
            found = screened(lambda some: judged(some, final_seed, screening_trials))
            study.set_user_attr("free", found)
        free = tuple(study.user_attrs["free"])
        tried = with_front(searched(study, free, candidates, suggested))
        best, finalists, alike, alone = final(
            tried, free, lambda some: judged(some, final_seed, fresh_trials)
        )
        everyone = [best, DEFAULT, {**DEFAULT, **NAIVE}]
        fresh = judged(everyone, fresh_seed, fresh_trials)
    after, before, naive = (ramp(one, starts) for one, starts in zip(everyone, fresh, strict=True))
    as_good = choose(fresh[:2]).alike
    tuning = Tuning(
        command="start",
        source=(
            f"campaign start-up, {trials} trials for each of {len(tried)} candidates, {fresh_trials} of seed "
            f"{final_seed} for {finalists} finalists; judged on {fresh_trials} of seed {fresh_seed}"
        ),
        seed=seed,
        range_is="values that, each alone, make no significant difference",
        parameters={name: tuned(name, best[name], min(alone[name]), max(alone[name])) for name in SPACE},
        figures_of_merit={
            **merits("", after),
            **merits("default_", before),
            **merits("naive_", naive),
            "candidates": Merit(float(len(tried)), "1"),
            "on_the_front": Merit(float(sum(one.on_front for one in tried)), "1"),
            "finalists": Merit(float(finalists), "1"),
            "finalists_alike": Merit(float(alike), "1"),
        },
        warnings=tuple(_warnings(free, as_good, after, screening_trials)),
        default_as_good=DEFAULT_PLACE in as_good,
    )
    return tuning, tried


def _warnings(free: Sequence[str], as_good: Sequence[int], fresh: Ramp, trials: int) -> Iterator[str]:
    """Warnings: free parameters, a default that is better, and starts that fail."""
    for name in free:
        low, high, _ = SPACE[name]
        yield f"{name} is free: at {low:g} as at {high:g} {trials} starts show no significant difference"
    if BEST_PLACE not in as_good:
        yield "on fresh trials the default is better: keep it, or search with more trials"
    if fresh.failures:
        yield f"{fresh.failures} of {fresh.eligible} fresh starts fail"


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
