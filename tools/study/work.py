"""Pieces of work on this machine's cores or a Dask cluster, with the same results on both.

A piece is a function of one plain specification and returns a table with some facts. On this machine pieces
run in threads: kernels release the interpreter's lock, so that threads use all cores as processes would, but
kernels are compiled or loaded only once and tables are passed on without a copy. Trials of campaigns run in
processes, because their judges are Python code.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from tools.jobs import results
from tools.output import BadInputError
from tools.progress import shown_progress
from tools.study import store

Piece = Callable[[store.Spec], tuple[pa.Table, dict[str, Any]]]


@dataclass(frozen=True)
class Where:
    """Folder of the results, and the workers: threads on this machine, or the workers of a Dask scheduler."""

    out: Path
    cores: int
    scheduler: str | None = None


def here(out: Path, cores: int | None = None, scheduler: str | None = None) -> Where:
    """Return checked settings; the default is all cores. Raises BadInputError for fewer than one core."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if cores is not None and cores < 1:
        raise BadInputError(f"--cores is {cores}: wanted 1 or more; leave it out for all {available}")
    return Where(out, cores or available, scheduler)


def run(
    kind: str, piece: Piece, specs: Sequence[store.Spec], where: Where, threads: bool = True
) -> list[Path]:
    """Compute the missing pieces and return the files of all pieces in the order of `specs`."""
    paths = [where.out / "pieces" / store.name_of(kind, spec) for spec in specs]
    missing = [index for index, path in enumerate(paths) if not store.is_complete(path)]
    if not missing:
        return paths
    found = results(piece, [specs[index] for index in missing], where.cores, where.scheduler, threads)
    with shown_progress() as progress:
        for done, (number, (table, facts)) in enumerate(found, len(specs) - len(missing) + 1):
            index = missing[number]
            store.write(paths[index], table, specs[index], facts)
            progress(done / len(specs), f"{kind} {done}/{len(specs)}")
    return paths
