"""Independent jobs, on this machine's cores or on the workers of a Dask scheduler."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

from hil.bench.workers import Workers, alive
from tools.output import BadInputError

Task = TypeVar("Task")
Result = TypeVar("Result")

Runner = Callable[[Sequence[Task]], Iterator[tuple[int, Result]]]
"""Yields the index and the result of each task, in the order in which they finish."""

CONNECT_TIMEOUT_S = 10.0


@contextmanager
def running(
    function: Callable[[Task], Result], cores: int, scheduler: str | None = None, threads: bool = False
) -> Iterator[Runner[Task, Result]]:
    """Give a runner of `function`; its processes keep their compiled kernels until the block ends.

    With processes, the first task runs alone: it compiles the kernels that the other processes load.
    `threads` is for kernels that release the interpreter's lock: they are compiled once, and results are not
    copied.
    """
    if scheduler is not None:
        with _client(scheduler) as client:
            yield lambda tasks: _on_cluster(client, function, tasks)
    elif threads and cores == 1:
        yield lambda tasks: enumerate(map(function, tasks))
    elif threads:
        with ThreadPoolExecutor(cores) as pool:
            yield lambda tasks: _in_threads(pool, function, tasks)
    else:
        with Workers(partial(_of_numbered, function), cores) as workers:
            yield lambda tasks: _in_processes(workers, tasks)


def _of_numbered(function: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return function(numbered[1])


def _in_processes(
    workers: Workers[tuple[int, Task], Result], tasks: Sequence[Task]
) -> Iterator[tuple[int, Result]]:
    numbered = list(enumerate(tasks))
    for some in (numbered[:1], numbered[1:]):
        for (number, _), result in workers.results(some):
            yield number, alive(result)


def _in_threads(
    pool: ThreadPoolExecutor, function: Callable[[Task], Result], tasks: Sequence[Task]
) -> Iterator[tuple[int, Result]]:
    futures = {pool.submit(function, task): number for number, task in enumerate(tasks)}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def _on_cluster(
    client: Any, function: Callable[[Task], Result], tasks: Sequence[Task]
) -> Iterator[tuple[int, Result]]:
    """Yield a cluster's results; the scheduler repeats a dead worker's unfinished tasks on other workers."""
    from distributed import as_completed as as_done

    futures = {client.submit(function, task, pure=False): number for number, task in enumerate(tasks)}
    for future in as_done(futures, loop=client.loop):  # type: ignore[no-untyped-call]  # distributed carries no types
        yield futures[future], future.result()
        future.release()


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
