"""Candidates of the firmware's parameters run through a campaign, all on the same trials.

A campaign's trial samples its truth from seed and number alone, so that candidates are compared in pairs.
Parameters are chosen with a seed below `FIRST_CAMPAIGN_SEED` and judged with a seed at or above this limit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from tools.campaign.campaign import Condition, Outcome
from tools.campaign.campaigns import CAMPAIGNS
from tools.campaign.processes import Batch, batches, run_batch
from tools.campaign.sampling import FIRST_CAMPAIGN_SEED
from tools.jobs import results
from tools.output import BadInputError
from tools.progress import Progress

TUNING_SEED = 41
FRESH_SEED = 30_000

Candidate = Mapping[str, float]


@dataclass(frozen=True)
class Sampling:
    """Seeds of the trials for the choice and for the judgement, and number of processes (None: one a core).

    Raises BadInputError unless the choice has a tuning seed and the judgement a campaign seed.
    """

    seed: int = TUNING_SEED
    fresh_seed: int = FRESH_SEED
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.seed >= FIRST_CAMPAIGN_SEED or self.fresh_seed < FIRST_CAMPAIGN_SEED:
            raise BadInputError(
                f"--seed {self.seed} and --fresh-seed {self.fresh_seed}: parameters are chosen on a seed "
                f"below {FIRST_CAMPAIGN_SEED} and judged on one from there on"
            )


SAMPLING = Sampling()


def points_of(grid: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Every combination of a grid's values."""
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


def run_candidates(
    campaign: str,
    candidates: Sequence[Candidate],
    seed: int,
    trials: int,
    progress: Progress = lambda *_: None,
    workers: int | None = None,
    conditions: tuple[Condition, ...] | None = None,
) -> list[list[Outcome]]:
    """Each candidate's outcomes, in order of the trials' numbers; all candidates have the same trials."""
    chosen = CAMPAIGNS[campaign]
    if conditions is not None:
        chosen = replace(chosen, conditions=conditions)
    parts: list[tuple[int, Batch]] = []
    for number, candidate in enumerate(candidates):
        settings = [f"firmware.{name}={value!r}" for name, value in candidate.items()]
        plan = chosen.plan(settings, seed)
        parts += [(number, batch) for batch in batches(plan, trials)]
    found: list[list[Outcome]] = [[] for _ in candidates]
    done, total = 0, trials * len(candidates)
    for place, outcomes in results(run_batch, [batch for _, batch in parts], workers):
        found[parts[place][0]] += outcomes
        done += len(outcomes)
        progress(done / total, "trials")
    return [sorted(outcomes, key=lambda outcome: outcome.trial) for outcomes in found]
