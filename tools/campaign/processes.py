"""Run a campaign's trials on all cores, or on a Dask scheduler's workers."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from firmware_py.shell.builds import Build
from tools.campaign.journal import Journal
from tools.campaign.trial.cells import Cell
from tools.campaign.trial.outcome import Outcome
from tools.jobs import running

BATCHES_A_WORKER = 16
LARGEST_BATCH = 32

Progress = Callable[[int, int], None]
"""Called with the number of finished trials and the number of all trials."""


class Batch(NamedTuple):
    """Trials of one campaign that a worker runs in one call."""

    campaign: str
    cells: list[Cell]
    numbers: Mapping[str, Any]
    seed: int
    trials: list[int]
    firmware: Build = "compiled"


def run_batch(batch: Batch) -> list[Outcome]:
    """Run the trials of a batch in a worker process."""
    from tools.campaign.trial.judges import run_trial

    return [
        run_trial(batch.campaign, batch.cells, batch.numbers, batch.seed, trial, batch.firmware)
        for trial in batch.trials
    ]


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for processes that are started within the context, and restore them."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def batches(
    campaign: str,
    cells: list[Cell],
    numbers: Mapping[str, Any],
    seed: int,
    trials: Sequence[int],
    workers: int,
    firmware: Build = "compiled",
) -> list[Batch]:
    """Divide the trials into batches.

    The first batch has one trial of each friction law, so that each kernel is compiled once.
    """
    laws: dict[str, int] = {}
    for trial in trials:
        laws.setdefault(cells[trial % len(cells)].law, trial)
    first = sorted(laws.values())
    rest = sorted(set(trials) - set(first))
    size = max(1, min(LARGEST_BATCH, len(rest) // (workers * BATCHES_A_WORKER)))
    parts = [first] + [rest[begin : begin + size] for begin in range(0, len(rest), size)]
    return [Batch(campaign, cells, numbers, seed, part, firmware) for part in parts if part]


def run_all(
    campaign: str,
    cells: list[Cell],
    numbers: Mapping[str, Any],
    seed: int,
    trials: int,
    progress: Progress,
    workers: int | None = None,
    scheduler: str | None = None,
    firmware: Build = "compiled",
) -> list[Outcome]:
    """Run all trials and return their outcomes in order of the trials' numbers.

    Outcomes that an interrupted campaign has left in its journal are taken from there.
    """
    count = workers or os.cpu_count() or 1
    with Journal(campaign, cells, numbers, seed, firmware) as journal:
        known = {outcome.trial: outcome for outcome in journal.outcomes}
        missing = [trial for trial in range(trials) if trial not in known]
        progress(trials - len(missing), trials)
        with running(run_batch, count, scheduler) as run:
            for _, part in run(batches(campaign, cells, numbers, seed, missing, count, firmware)):
                journal.add(part)
                known |= {outcome.trial: outcome for outcome in part}
                progress(sum(trial in known for trial in range(trials)), trials)
    return [known[trial] for trial in range(trials)]
