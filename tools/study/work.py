"""Pieces of work, spread over this machine's cores or a Dask cluster; same results on any of them.

A piece is a function of one plain specification and returns a table with some facts beside it. Kernels run
without the interpreter's lock, so that threads of this process use all cores and share what is compiled.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tools.output import BadInputError, progress_console
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


def run(kind: str, piece: Piece, specs: Sequence[store.Spec], where: Where) -> list[Path]:
    """Compute what is missing and return the pieces' files in the order of `specs`."""
    paths = [where.out / "pieces" / store.name_of(kind, spec) for spec in specs]
    missing = [index for index, path in enumerate(paths) if not store.is_complete(path)]
    with _progress() as progress:
        task = progress.add_task(kind, total=len(specs), completed=len(specs) - len(missing))
        for index, (table, facts) in _results(piece, [(index, specs[index]) for index in missing], where):
            store.write(paths[index], table, specs[index], facts)
            progress.advance(task)
    return paths


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=progress_console,
        transient=True,
    )


def _results(
    piece: Piece, numbered: list[tuple[int, store.Spec]], where: Where
) -> Iterator[tuple[int, tuple[pa.Table, dict[str, Any]]]]:
    """Each piece's number and result as it is done."""
    if not numbered:
        return
    if where.scheduler is not None:
        yield from _on_cluster(piece, numbered, where.scheduler)
    elif where.cores == 1:
        for index, spec in numbered:
            yield index, piece(spec)
    else:
        with ThreadPoolExecutor(where.cores) as pool:
            futures = {pool.submit(piece, spec): index for index, spec in numbered}
            try:
                for future in _as_done(futures):
                    yield futures[future], future.result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)


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
            yield futures[future], future.result()
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
