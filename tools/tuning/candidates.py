"""Candidates of the firmware's parameters run through a campaign, all on the same trials.

A campaign's trial samples its truth from seed and number alone, so that candidates are compared in pairs.
Parameters are chosen with a seed below `FIRST_CAMPAIGN_SEED` and judged with a seed at or above this limit.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from tools.campaign.campaigns import CAMPAIGNS
from tools.campaign.processes import Batch, batches, run_batch
from tools.campaign.trial.cells import Condition
from tools.campaign.trial.outcome import Outcome
from tools.campaign.trial.sampling import FIRST_CAMPAIGN_SEED
from tools.jobs import Runner, running
from tools.output import BadInputError
from tools.progress import Counted

TUNING_SEED = 41
FRESH_SEED = 30_000

Candidate = Mapping[str, float]


def refuse_same_seeds(seed: int, fresh_seed: int) -> None:
    """Raise BadInputError unless candidates are chosen on tuning seeds and judged on campaign seeds."""
    if seed >= FIRST_CAMPAIGN_SEED or fresh_seed < FIRST_CAMPAIGN_SEED:
        raise BadInputError(
            f"--seed {seed} and --fresh-seed {fresh_seed}: parameters are chosen on a seed below "
            f"{FIRST_CAMPAIGN_SEED} and judged on one from there on"
        )


def processes_for(workers: int | None) -> AbstractContextManager[Runner[Batch, list[Outcome]]]:
    """Processes that run candidates; without `workers`, one per core."""
    return running(run_batch, workers or os.cpu_count() or 1)


def run_candidates(
    campaign: str,
    candidates: Sequence[Candidate],
    seed: int,
    trials: int,
    progress: Counted,
    workers: int | None = None,
    conditions: tuple[Condition, ...] | None = None,
    opened: Runner[Batch, list[Outcome]] | None = None,
) -> list[list[Outcome]]:
    """Each candidate's outcomes, in order of the trials' numbers; all candidates have the same trials.

    `opened`: processes to reuse; they have kept their compiled kernels and the references of these trials.
    """
    chosen = CAMPAIGNS[campaign]
    if conditions is not None:
        chosen = replace(chosen, conditions=conditions)
    count = workers or os.cpu_count() or 1
    parts: list[tuple[int, Batch]] = []
    for number, candidate in enumerate(candidates):
        settings = [f"firmware.{name}={value!r}" for name, value in candidate.items()]
        plan = chosen.plan(settings, seed)
        parts += [(number, batch) for batch in batches(plan, range(trials), count)]
    found: list[list[Outcome]] = [[] for _ in candidates]
    done, total = 0, trials * len(candidates)
    with nullcontext(opened) if opened else processes_for(count) as run:
        for place, outcomes in run([batch for _, batch in parts]):
            found[parts[place][0]] += outcomes
            done += len(outcomes)
            progress(done, total)
    return [sorted(outcomes, key=lambda outcome: outcome.trial) for outcomes in found]
