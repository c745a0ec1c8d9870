"""Trials on all cores, or on a Dask scheduler's workers.

A worker has to be a process that compiles the firmware: the variable that says so is set before anything of
the firmware is imported, which is why this module imports none of it.
"""

import itertools
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, NamedTuple

from hil.realtime import die_with_parent
from tools.campaign.cells import Cell
from tools.campaign.journal import Journal
from tools.campaign.outcome import Outcome
from tools.output import BadInputError

BATCHES_A_WORKER = 16
LARGEST_BATCH = 32
SCHEDULER_TIMEOUT_S = "10s"
VARIABLE = "VIBROHIL_COMPILED"

Progress = Callable[[int, int], None]
"""Called with how many trials are done, of how many."""


class WorkerError(RuntimeError):
    """A worker that cannot run trials."""


class Batch(NamedTuple):
    """Some trials of one campaign."""

    campaign: str
    cells: list[Cell]
    numbers: Mapping[str, Any]
    seed: int
    trials: list[int]


def prepare() -> None:
    """Make this process one that compiles the firmware; before anything of it is imported."""
    imported = sys.modules.get("firmware_py.core.compiled")
    if imported is None:
        os.environ[VARIABLE] = "1"
    elif not imported.COMPILED:
        raise WorkerError(
            "this worker has imported the interpreted firmware; start it with VIBROHIL_COMPILED=1"
        )


def begin_worker() -> None:
    """A worker of this machine: it leaves Ctrl-C to the program that started it, and ends with it."""
    prepare()
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_batch(batch: Batch) -> list[Outcome]:
    """Run some trials, in a worker."""
    prepare()
    from tools.campaign.trials import run_trial

    return [
        run_trial(batch.campaign, batch.cells, batch.numbers, batch.seed, trial) for trial in batch.trials
    ]


def run_endurance(ticks: int, settings: Sequence[str]) -> dict[str, Any]:
    """The endurance run, in a worker."""
    prepare()
    from tools.campaign.endurance import endurance

    return endurance(ticks, settings)


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Variables of the environment for processes that are started within."""
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


@contextmanager
def pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that compile the firmware, while this one stays as it is.

    Whatever is raised in the block, such as an interruption, ends them at once.
    """
    import firmware_py.core.compiled  # noqa: F401 - settled here before the variable is set for the workers

    others = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=begin_worker
    )
    with environment({VARIABLE: "1"}), executor:
        try:
            yield executor
        except BaseException:
            for child in set(multiprocessing.active_children()) - others:
                child.kill()
            raise


def batches(
    campaign: str,
    cells: list[Cell],
    numbers: Mapping[str, Any],
    seed: int,
    trials: Sequence[int],
    workers: int,
) -> tuple[Batch, list[Batch]]:
    """One trial of each friction law, which has the kernels compiled once, and the rest."""
    laws: dict[str, int] = {}
    for trial in trials:
        laws.setdefault(cells[trial % len(cells)].law, trial)
    first = sorted(laws.values())
    rest = sorted(set(trials) - set(first))
    size = max(1, min(LARGEST_BATCH, len(rest) // (workers * BATCHES_A_WORKER)))
    return Batch(campaign, cells, numbers, seed, first), [
        Batch(campaign, cells, numbers, seed, rest[begin : begin + size])
        for begin in range(0, len(rest), size)
    ]


Finished = Callable[[Sequence[Batch]], Iterator[list[Outcome]]]
"""Runs batches and hands on their outcomes as they come."""


@contextmanager
def _here(workers: int) -> Iterator[Finished]:
    """On this machine's cores."""
    with pool(workers) as executor:

        def finished(some: Sequence[Batch]) -> Iterator[list[Outcome]]:
            futures = [executor.submit(run_batch, batch) for batch in some]
            try:
                for future in as_completed(futures):
                    yield future.result()
            finally:
                for future in futures:
                    future.cancel()

        yield finished


@contextmanager
def _on_dask(address: str) -> Iterator[Finished]:
    """On the workers of the Dask scheduler at `address`."""
    import distributed

    dask: Any = distributed
    try:
        client = dask.Client(address, timeout=SCHEDULER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}); start one with "
            "'dask scheduler' and workers with 'VIBROHIL_COMPILED=1 dask worker ADDRESS --nthreads 1'"
        ) from error
    with client:

        def finished(some: Sequence[Batch]) -> Iterator[list[Outcome]]:
            futures = client.map(run_batch, list(some), pure=False)
            for future in dask.as_completed(futures):
                yield future.result()

        yield finished


def run_all(
    campaign: str,
    cells: list[Cell],
    numbers: Mapping[str, Any],
    seed: int,
    trials: int,
    progress: Progress,
    workers: int | None = None,
    scheduler: str | None = None,
) -> list[Outcome]:
    """All trials, in order of their numbers; those that an interrupted campaign has finished are kept."""
    count = workers or os.cpu_count() or 1
    source = _on_dask(scheduler) if scheduler else _here(count)
    with Journal(campaign, cells, numbers, seed) as journal:
        known = {outcome.trial: outcome for outcome in journal.outcomes}
        missing = [trial for trial in range(trials) if trial not in known]
        progress(trials - len(missing), trials)
        with source as finished:
            first, rest = batches(campaign, cells, numbers, seed, missing, count)
            for part in itertools.chain(finished([first]), finished(rest)):
                journal.add(part)
                known |= {outcome.trial: outcome for outcome in part}
                progress(sum(trial in known for trial in range(trials)), trials)
    return [known[trial] for trial in range(trials)]
