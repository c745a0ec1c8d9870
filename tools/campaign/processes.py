"""Run a campaign's trials on all cores, or on a Dask scheduler's workers."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from hil.record import provenance
from hil.record.run_folder import RUNS, FolderInUseError, locked
from tools.campaign.campaign import Outcome, Plan
from tools.campaign.campaigns import run_trial
from tools.output import BadInputError
from tools.study import work

BATCHES = 64
LARGEST_BATCH = 32


class Batch(NamedTuple):
    """Trials of one campaign that a worker runs in one call."""

    plan: Plan
    trials: list[int]


def run_batch(batch: Batch) -> list[Outcome]:
    """Run the trials of a batch in a worker process."""
    return [run_trial(batch.plan, trial) for trial in batch.trials]


def batches(plan: Plan, trials: int) -> list[Batch]:
    """Divide the trials into batches; the division depends on their number alone."""
    size = max(1, min(LARGEST_BATCH, trials // BATCHES))
    begins = range(0, trials, size)
    return [Batch(plan, list(range(begin, min(begin + size, trials)))) for begin in begins]


def run_piece(batch: Batch) -> list[dict[str, Any]]:
    """Run the trials of a batch; return their outcomes as JSON can hold them."""
    return [asdict(outcome) for outcome in run_batch(batch)]


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Make a campaign's folder and lock it until the end of the block; an empty folder is then removed.

    Raises BadInputError if another process has locked it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(folder))
        except FolderInUseError as error:
            raise BadInputError(
                f"{folder} is in use by the same campaign or search; wait until it has ended, or work in "
                "another folder"
            ) from error
        try:
            yield
        finally:
            with suppress(OSError):  # it holds finished batches, or is gone
                folder.rmdir()


def folder_of(plan: Plan, trials: int) -> Path:
    """The folder of a campaign's finished batches while it runs.

    Its name contains a digest of everything on which the batches and their outcomes depend.
    """
    return RUNS / f"campaign-{plan.campaign}-{provenance.key(plan, trials)[:16]}"


def outcomes_of(found: Sequence[Sequence[Mapping[str, Any]]]) -> list[Outcome]:
    """The outcomes in the results of batches."""
    return [Outcome(**outcome) for outcomes in found for outcome in outcomes]


def read_finished(plan: Plan, trials: int) -> list[Outcome]:
    """The outcomes of an interrupted campaign's finished batches."""
    tasks = batches(plan, trials)
    paths = work.paths_of("batch", tasks, folder_of(plan, trials))
    stored = map(work.read_stored, paths, tasks)
    return outcomes_of([found for found in stored if found is not None])


def run_all(
    plan: Plan, trials: int, workers: int | None = None, scheduler: str | None = None
) -> list[Outcome]:
    """Run all trials and return their outcomes in order of the trials' numbers.

    The batches that an interrupted campaign has finished are taken from its folder. Raises BadInputError if
    the same campaign is running.
    """
    folder = folder_of(plan, trials)
    where = work.Where(folder, workers, scheduler)
    with claimed(folder):
        found = work.run("batch", run_piece, batches(plan, trials), where, threads=False)
        shutil.rmtree(folder)
    return outcomes_of(found)
