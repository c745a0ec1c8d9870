"""Pieces of work, spread over this machine's cores or a Dask cluster; same results on any of them.

A piece is a function of one plain specification and returns a table with some facts beside it. On this
machine pieces run in threads: kernels hold no interpreter's lock, so that threads use all cores as processes
would, while kernels are compiled or loaded once and tables are handed on without a copy. Closed loops with
the firmware run in processes, as a process has either the compiled firmware or the interpreted one.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from tools.campaign import processes
from tools.output import BadInputError
from tools.progress import counted_progress
from tools.study import store

Piece = Callable[[store.Spec], tuple[pa.Table, dict[str, Any]]]

CONNECT_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Where:
    """Folder of the results, and who computes them: threads here, or the workers of a Dask scheduler."""

    out: Path
    cores: int
    scheduler: str | None = None


def here(out: Path, cores: int | None = None, scheduler: str | None = None) -> Where:
    """Checked settings; all cores by default."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if cores is not None and cores < 1:
        raise BadInputError(f"--cores is {cores}: wanted 1 or more; leave it out for all {available}")
    return Where(out, cores or available, scheduler)


def run(
    kind: str,
    piece: Piece,
    specs: Sequence[store.Spec],
    where: Where,
    with_compiled_firmware: bool = False,
) -> list[Path]:
    """Compute what is missing and return the pieces' files in the order of `specs`."""
    paths = [where.out / "pieces" / store.name_of(kind, spec) for spec in specs]
    missing = [index for index, path in enumerate(paths) if not store.is_complete(path)]
    with counted_progress(kind, len(specs)) as progress:
        numbered = [(index, specs[index]) for index in missing]
        results = _results(piece, numbered, where, with_compiled_firmware)
        for done, (index, (table, facts)) in enumerate(results, len(specs) - len(missing) + 1):
            store.write(paths[index], table, specs[index], facts)
            progress(done)
    return paths


def _results(
    piece: Piece, numbered: list[tuple[int, store.Spec]], where: Where, with_compiled_firmware: bool
) -> Iterator[tuple[int, tuple[pa.Table, dict[str, Any]]]]:
    """Each piece's number and result as it is done."""
    if not numbered:
        return
    if where.scheduler is not None:
        yield from _on_cluster(piece, numbered, where.scheduler)
    elif with_compiled_firmware:
        with processes.pool(where.cores) as pool:
            # The first compiles what the others load.
            yield from _in_pool(pool, piece, numbered[:1])
            yield from _in_pool(pool, piece, numbered[1:])
    elif where.cores == 1:
        for index, spec in numbered:
            yield index, piece(spec)
    else:
        with ThreadPoolExecutor(where.cores) as threads:
            yield from _in_pool(threads, piece, numbered)


def _in_pool(
    pool: Executor, piece: Piece, numbered: list[tuple[int, store.Spec]]
) -> Iterator[tuple[int, tuple[pa.Table, dict[str, Any]]]]:
    futures = {pool.submit(piece, spec): index for index, spec in numbered}
    try:
        for future in _as_done(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def _as_done(futures: Iterable[Future[Any]]) -> Iterator[Future[Any]]:
    pending = set(futures)
    while pending:
        done, pending = wait(pending, return_when=FIRST_COMPLETED)
        yield from done


def _on_cluster(
    piece: Piece, numbered: list[tuple[int, store.Spec]], address: str
) -> Iterator[tuple[int, tuple[pa.Table, dict[str, Any]]]]:
    """A worker that dies only costs the pieces it had not handed back: the scheduler gives them to others."""
    from distributed import as_completed

    with _client(address) as client:
        futures = {client.submit(piece, spec, pure=False): index for index, spec in numbered}
        for future in as_completed(futures, loop=client.loop):  # type: ignore[no-untyped-call]  # distributed carries no types
            try:
                result = future.result()
            except processes.WorkerError as error:
                raise BadInputError(f"--scheduler {address}: {error}") from error
            yield futures[future], result
            future.release()


@contextmanager
def _client(address: str) -> Iterator[Any]:
    from distributed import Client

    try:
        client = Client(  # type: ignore[no-untyped-call]  # distributed carries no types
            address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
        )
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"--scheduler is {address!r}, where no Dask scheduler answers ({error}); start one with "
            "`dask scheduler`, its workers with `dask worker ADDRESS`, and give the address it prints"
        ) from error
    with client:
        yield client
