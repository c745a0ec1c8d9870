"""Independent jobs, on this machine's cores or on the workers of a Dask scheduler."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from typing import Any, Generic, TypeVar

from hil.processes.workers import Workers, alive
from tools.output import BadInputError

Task = TypeVar("Task")
Result = TypeVar("Result")

CONNECT_TIMEOUT_S = 10.0


Run = Callable[[Sequence[Task]], Iterator[tuple[int, Result]]]
"""Yields the index and the result of each task, in the order in which they finish."""


def results(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int | None = None,
    scheduler: str | None = None,
    threads: bool = False,
) -> Iterator[tuple[int, Result]]:
    """Yield the index and the result of each task, in the order in which they finish."""
    with pool(function, workers, scheduler, threads) as run:
        yield from run(tasks)


@contextmanager
def pool(
    function: Callable[[Task], Result],
    workers: int | None = None,
    scheduler: str | None = None,
    threads: bool = False,
) -> "Iterator[Run[Task, Result]]":
    """Give a function that runs lists of tasks, one list after another, on the same workers.

    `workers`: the number of processes or threads; by default one for each core that this process may use.
    With processes, the first task runs alone: it compiles the kernels that the other processes load.
    `threads` is for kernels that release the interpreter's lock: they are compiled once, and results are not
    copied. A scheduler repeats a dead worker's unfinished tasks on other workers.
    """
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = workers or available or 1
    if scheduler is not None:
        with _client(scheduler) as client, client.get_executor(pure=False) as executor:
            yield partial(_run_in_pool, executor, function)
    elif threads and workers == 1:
        yield lambda tasks: enumerate(map(function, tasks))
    elif threads:
        with ThreadPoolExecutor(workers) as executor:
            yield partial(_run_in_pool, executor, function)
    else:
        with Workers(partial(_call_numbered, function), workers) as processes:
            yield _Processes(processes).run


class _Processes(Generic[Task, Result]):
    """Runs lists of tasks in worker processes."""

    def __init__(self, workers: Workers[tuple[int, Task], Result]) -> None:
        self._workers = workers
        self._alone = 1

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Result]]:
        """Run the tasks; of the first list the first task runs alone."""
        numbered = list(enumerate(tasks))
        alone, self._alone = self._alone, 0
        for some in (numbered[:alone], numbered[alone:]):
            for (number, _), result in self._workers.results(some):
                yield number, alive(result)


def _call_numbered(function: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return function(numbered[1])


def _run_in_pool(
    pool: Executor, function: Callable[[Task], Result], tasks: Sequence[Task]
) -> Iterator[tuple[int, Result]]:
    futures = {pool.submit(function, task): number for number, task in enumerate(tasks)}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


@contextmanager
def _client(address: str) -> Iterator[Any]:
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port

    try:
        protocol, place = parse_address(address)
        if protocol in ("tcp", "tls"):
            parse_host_port(place)  # for an invalid address, Client would fail only after 20 s
        client = Client(  # type: ignore[no-untyped-call]  # distributed carries no types
            address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
        )
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}); start one with "
            "`dask scheduler --host 127.0.0.1`, its workers with `dask worker ADDRESS --nthreads 1`, and "
            "give the address it prints; whoever reaches it runs code, so use TLS between machines"
        ) from error
    with client:
        yield client
