"""The soft start's ramp, for reliability first: how long the rise and the second try take, on drawn starts.

Candidates run the start-up campaign, all on the same draws of truth and state. Better is, in this
order: fewer starts that fail where an impact attractor exists; a largest blow on the way no more than
`OVERSHOOT` of the steady one (or of a slow way up); an earlier capture. So a faster ramp wins only
where it loses no start. The winner is judged beside the default on seeds that had no part in the choice.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from tools.campaign.outcome import Outcome
from tools.campaign.results import counts_of, values_of
from tools.campaign.statistics import wilson
from tools.tuning.candidates import FRESH_SEED, TUNING_SEED, grid, refuse_same_seeds, run_candidates
from tools.tuning.result import Merit, Tuning, tuned

RISE, AGAIN = "start.rise_s", "start.again_s"
RISES_S = (2.0, 3.5, 5.0, 7.0)
AGAINS_S = (1.0, 2.0)
TRIALS = 60
"""Five of each friction law and ratio."""
FRESH_TRIALS = 120
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

    @property
    def rank(self) -> tuple[float, float, float]:
        """Smaller is better: failures, overshoot beyond what is allowed, capture."""
        return (self.failures, max(self.overshoot, OVERSHOOT), self.capture_p95_s)

    @property
    def success_low(self) -> float:
        """Wilson's lower bound of the share that succeeds."""
        return wilson(self.eligible - self.failures, self.eligible).low


def ramp(parameters: dict[str, float], outcomes: Sequence[Outcome]) -> Ramp:
    """What a candidate's starts came to."""
    counts, values = counts_of(outcomes), values_of(outcomes)
    captures = np.array(values.get("capture", [math.inf]))
    blows = [*values.get("overshoot", []), *values.get("overshoot_low", [])]
    return Ramp(
        parameters=parameters,
        eligible=counts["eligible"],
        failures=counts["eligible"] - counts["success"],
        overshoot=max(blows, default=math.inf),
        capture_p50_s=float(np.median(captures)),
        capture_p95_s=float(np.percentile(captures, 95)),
    )


def tune_start(
    trials: int = TRIALS,
    fresh_trials: int = FRESH_TRIALS,
    seed: int = TUNING_SEED,
    fresh_seed: int = FRESH_SEED,
    rises_s: Sequence[float] | None = None,
    agains_s: Sequence[float] | None = None,
    progress: Progress = lambda *_: None,
    workers: int | None = None,
) -> tuple[Tuning, list[Ramp]]:
    """The ramp that fails least, and all that were tried."""
    refuse_same_seeds(seed, fresh_seed)
    candidates = grid(start__rise_s=rises_s or RISES_S, start__again_s=agains_s or AGAINS_S)
    total = trials * len(candidates) + 2 * fresh_trials
    tried = [
        ramp(candidate, outcomes)
        for candidate, outcomes in zip(
            candidates,
            run_candidates(
                "start-up", candidates, seed, trials, lambda done, _: progress(done, total), workers
            ),
            strict=True,
        )
    ]
    best = min(tried, key=lambda one: one.rank)
    default = {name: DEFAULTS[name] for name in (RISE, AGAIN)}
    fresh, before = (
        ramp(candidate, outcomes)
        for candidate, outcomes in zip(
            (best.parameters, default),
            run_candidates(
                "start-up",
                [best.parameters, default],
                fresh_seed,
                fresh_trials,
                lambda done, _: progress(total - 2 * fresh_trials + done, total),
                workers,
            ),
            strict=True,
        )
    )
    warnings = []
    if fresh.rank > before.rank:
        warnings.append(
            "on fresh draws the default is better: too few trials to choose by, or keep the default"
        )
    if fresh.failures:
        warnings.append(f"{fresh.failures} of {fresh.eligible} fresh starts fail")
    # Those that failed as seldom: as wide as the choice leaves each parameter.
    as_good = [one.parameters for one in tried if one.failures == best.failures]
    tuning = Tuning(
        command="start",
        source=(
            f"campaign start-up, {trials} trials for each of {len(candidates)} ramps; judged on "
            f"{fresh_trials} trials of seed {fresh_seed}"
        ),
        seed=seed,
        range_is="ramps that fail as seldom",
        parameters={
            name: tuned(
                name,
                best.parameters[name],
                min(one[name] for one in as_good),
                max(one[name] for one in as_good),
            )
            for name in (RISE, AGAIN)
        },
        figures_of_merit={**merits("", fresh), **merits("default_", before)},
        warnings=tuple(warnings),
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
    }
