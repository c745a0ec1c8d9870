"""The soft start for reliability first: ramp, capture speed and hold loop, searched by Optuna in lockstep.

Candidates run the start-up campaign, all on the same draws of truth and state. There are four aims: the share
of starts that fail where an impact attractor exists, the largest blow on the way beside the steady one, the
time until 95 % are captured, and the energy that takes. Optuna (Akiba et al., KDD 2019) searches all four at
once; what no other candidate beats in all of them is the Pareto front. Of that the winner is taken in the
order of the aims, an overshoot within `OVERSHOOT` counting as none: a faster ramp wins only where it loses
no start. The front's first few, the default and a naive start are judged on seeds that had no part in it.

The search is kept in a journal beside the parameter file: the same command goes on where it was killed.
"""

import hashlib
import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from tools.campaign.outcome import Outcome
from tools.campaign.results import counts_of, values_of
from tools.campaign.statistics import wilson
from tools.tuning.candidates import FRESH_SEED, TUNING_SEED, refuse_same_seeds, run_candidates
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
"""Lowest, highest and step of what is searched; a finer step makes no difference that draws could tell."""
NAIVE = {RISE: 0.5, AGAIN: 0.5}
"""Up to speed as fast as the motor follows."""
CANDIDATES = 24
BATCH = 6
"""Candidates that are asked for at a time: they share the start of the processes."""
TRIALS = 60
"""Five of each friction law and ratio."""
FRESH_TRIALS = 120
FINALISTS = 3
OVERSHOOT = 1.05

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Ramp:
    """A candidate and what it came to; `overshoot` is the largest of all starts."""

    parameters: dict[str, float]
    eligible: int
    failures: int
    overshoot: float
    capture_p50_s: float
    capture_p95_s: float
    energy_p50_j: float
    on_front: bool = False

    @property
    def aims(self) -> tuple[float, float, float, float]:
        """Each the less the better: failures, overshoot, time, energy."""
        return (self.failures / max(self.eligible, 1), self.overshoot, self.capture_p95_s, self.energy_p50_j)

    @property
    def rank(self) -> tuple[float, float, float, float]:
        """Smaller is better: failures, overshoot beyond what is allowed, capture, energy."""
        failed, overshoot, capture_s, energy_j = self.aims
        return (failed, max(overshoot, OVERSHOOT), capture_s, energy_j)

    @property
    def success_low(self) -> float:
        """Wilson's lower bound of the share that succeeds."""
        return wilson(self.eligible - self.failures, self.eligible).low


def ramp(parameters: Mapping[str, float], outcomes: Sequence[Outcome]) -> Ramp:
    """What a candidate's starts came to."""
    counts, values = counts_of(outcomes), values_of(outcomes)
    captures = np.array(values.get("capture", [math.inf]))
    blows = [*values.get("overshoot", []), *values.get("overshoot_low", [])]
    return Ramp(
        parameters=dict(parameters),
        eligible=counts["eligible"],
        failures=counts["eligible"] - counts["success"],
        overshoot=max(blows, default=math.inf),
        capture_p50_s=float(np.median(captures)),
        capture_p95_s=float(np.percentile(captures, 95)),
        energy_p50_j=float(np.median(values.get("energy", [math.inf]))),
    )


def dominates(one: Ramp, other: Ramp) -> bool:
    """Whether no aim of `other` is met better, and one is met worse."""
    pairs = list(zip(one.aims, other.aims, strict=True))
    return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)


def with_front(tried: Sequence[Ramp]) -> list[Ramp]:
    """All, those that nothing dominates marked."""
    return [
        Ramp(**{**vars(one), "on_front": not any(dominates(other, one) for other in tried)}) for one in tried
    ]


# --- the search ---------------------------------------------------------------------------------------


def study_in(journal: Path, name: str, seed: int) -> "optuna.Study":
    """The search as the journal has it, or a new one that begins with the default."""
    import optuna
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    journal.parent.mkdir(parents=True, exist_ok=True)
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
    default = {key: DEFAULTS[key] for key in SPACE}
    if all(one.parameters != default for one in finished(study)):
        study.enqueue_trial(default, skip_if_exists=False)
    return study


def asked(study: "optuna.Study", count: int) -> list[tuple["optuna.Trial", dict[str, float]]]:
    """So many candidates of the search space."""
    found = []
    for _ in range(count):
        trial = study.ask()
        values = {
            name: trial.suggest_float(name, low, high, step=step) for name, (low, high, step) in SPACE.items()
        }
        found.append((trial, values))
    return found


def finished(study: "optuna.Study") -> list[Ramp]:
    """What the journal knows; a candidate that was not finished when the search was killed is none."""
    return [
        Ramp(parameters=dict(trial.params), **trial.user_attrs["ramp"])
        for trial in study.trials
        if trial.values is not None
    ]


def searched(
    study: "optuna.Study", candidates: int, trials: int, seed: int, progress: Progress, workers: int | None
) -> list[Ramp]:
    """Ask, run, tell, until so many candidates are known."""
    known = finished(study)
    while len(known) < candidates:
        progress(len(known) * trials, candidates * trials)
        batch = asked(study, min(BATCH, candidates - len(known)))
        begun = len(known) * trials

        def told(done: int, _: int, begun: int = begun) -> None:
            progress(begun + done, candidates * trials)

        outcomes = run_candidates(
            "start-up",
            [values for _, values in batch],
            seed,
            trials,
            told,
            workers,
        )
        for (trial, values), some in zip(batch, outcomes, strict=True):
            one = ramp(values, some)
            numbers = {
                key: value for key, value in vars(one).items() if key not in ("parameters", "on_front")
            }
            trial.set_user_attr("ramp", numbers)
            study.tell(trial, [min(aim, 1e9) for aim in one.aims])
        known = finished(study)
    return known


def tune_start(
    journal: Path,
    candidates: int = CANDIDATES,
    trials: int = TRIALS,
    fresh_trials: int = FRESH_TRIALS,
    seed: int = TUNING_SEED,
    fresh_seed: int = FRESH_SEED,
    progress: Progress = lambda *_: None,
    workers: int | None = None,
) -> tuple[Tuning, list[Ramp]]:
    """The start that fails least, and all that were tried."""
    refuse_same_seeds(seed, fresh_seed)
    asked_for = json.dumps({"space": SPACE, "trials": trials, "seed": seed}, sort_keys=True)
    study = study_in(journal, f"start-{hashlib.sha256(asked_for.encode()).hexdigest()[:12]}", seed)
    tried = with_front(searched(study, candidates, trials, seed, progress, workers))
    front = sorted((one for one in tried if one.on_front), key=lambda one: one.rank)
    finalists = [one.parameters for one in front[:FINALISTS]]
    default = {name: DEFAULTS[name] for name in SPACE}
    everyone = [*finalists, default, {**default, **NAIVE}]
    judged = [
        ramp(parameters, outcomes)
        for parameters, outcomes in zip(
            everyone,
            run_candidates("start-up", everyone, fresh_seed, fresh_trials, progress, workers),
            strict=True,
        )
    ]
    fresh, (before, naive) = min(judged[:-2], key=lambda one: one.rank), judged[-2:]
    warnings_ = []
    if fresh.rank > before.rank:
        warnings_.append("on fresh draws the default is better: keep it, or search with more trials")
    if fresh.failures:
        warnings_.append(f"{fresh.failures} of {fresh.eligible} fresh starts fail")
    # Those that fail as seldom and strike no harder than allowed.
    least = min(one.rank[:2] for one in tried)
    as_good = [one.parameters for one in tried if one.rank[:2] == least]
    tuning = Tuning(
        command="start",
        source=(
            f"campaign start-up, {trials} trials for each of {len(tried)} candidates, {len(front)} on the "
            f"Pareto front; judged on {fresh_trials} trials of seed {fresh_seed}"
        ),
        seed=seed,
        range_is="candidates that fail as seldom and strike no harder than allowed",
        parameters={
            name: tuned(
                name,
                fresh.parameters[name],
                min(fresh.parameters[name], *(one[name] for one in as_good)),
                max(fresh.parameters[name], *(one[name] for one in as_good)),
            )
            for name in SPACE
        },
        figures_of_merit={
            **merits("", fresh),
            **merits("default_", before),
            **merits("naive_", naive),
            "candidates": Merit(float(len(tried)), "1"),
            "on_the_front": Merit(float(len(front)), "1"),
        },
        warnings=tuple(warnings_),
    )
    return tuning, tried


def merits(prefix: str, one: Ramp) -> dict[str, Merit]:
    """On fresh draws."""
    return {
        f"{prefix}eligible": Merit(float(one.eligible), "1"),
        f"{prefix}failures": Merit(float(one.failures), "1"),
        f"{prefix}success_low": Merit(one.success_low, "1"),
        f"{prefix}largest_overshoot": Merit(one.overshoot, "1"),
        f"{prefix}capture_p50": Merit(one.capture_p50_s, "s"),
        f"{prefix}capture_p95": Merit(one.capture_p95_s, "s"),
        f"{prefix}energy_p50": Merit(one.energy_p50_j, "J"),
    }
