"""Run a campaign's trials on all cores, or on a Dask scheduler's workers."""

import os
from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

from hil.record import provenance
from hil.record.run_folder import RUNS
from tools.campaign.journal import journal
from tools.campaign.trial.outcome import Outcome
from tools.campaign.trial.scenarios import Plan
from tools.jobs import running
from tools.progress import Counted

BATCHES_A_WORKER = 16
LARGEST_BATCH = 32


class Batch(NamedTuple):
    """Trials of one campaign that a worker runs in one call."""

    plan: Plan
    trials: list[int]


def run_batch(batch: Batch) -> list[Outcome]:
    """Run the trials of a batch in a worker process."""
    from tools.campaign.trial.judges import run_trial

    return [run_trial(batch.plan, trial) for trial in batch.trials]


def batches(plan: Plan, trials: Sequence[int], workers: int) -> list[Batch]:
    """Divide the trials into batches.

    The first batch has one trial of each friction law, so that each kernel is compiled once.
    """
    laws: dict[str, int] = {}
    for trial in trials:
        laws.setdefault(plan.cell_of(trial).law, trial)
    first = sorted(laws.values())
    rest = sorted(set(trials) - set(first))
    size = max(1, min(LARGEST_BATCH, len(rest) // (workers * BATCHES_A_WORKER)))
    parts = [first] + [rest[begin : begin + size] for begin in range(0, len(rest), size)]
    return [Batch(plan, part) for part in parts if part]


def run_all(
    plan: Plan, trials: int, progress: Counted, workers: int | None = None, scheduler: str | None = None
) -> list[Outcome]:
    """Run all trials and return their outcomes in order of the trials' numbers.

    Outcomes that an interrupted campaign has left in its journal are taken from there. The journal's name
    contains a digest of everything on which an outcome depends.
    """
    count = workers or os.cpu_count() or 1
    RUNS.mkdir(exist_ok=True)
    path = RUNS / f"campaign-{plan.campaign}-{provenance.key(plan)[:16]}.jsonl"
    with journal(path) as (entries, add):
        known = {entry["trial"]: Outcome(**entry) for entry in entries}
        missing = [trial for trial in range(trials) if trial not in known]
        progress(trials - len(missing), trials)
        with running(run_batch, count, scheduler) as run:
            for _, outcomes in run(batches(plan, missing, count)):
                for outcome in outcomes:
                    add(asdict(outcome))
                    known[outcome.trial] = outcome
                progress(sum(trial in known for trial in range(trials)), trials)
    path.unlink(missing_ok=True)
    return [known[trial] for trial in range(trials)]
