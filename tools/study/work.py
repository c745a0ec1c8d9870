"""Pieces of work on this machine's cores or a Dask cluster, with the same results on both.

A piece is a function of one task and returns what JSON can hold. Each result is a file with its task and the
versions of everything on which it depends; its name is a digest of them. A killed study therefore continues
where it stopped, and a study whose sources have changed starts again. A digest of the result shows a file
that was changed since: its readers rely on the types that the piece has returned.

On this machine pieces run in threads: kernels release the interpreter's lock, so that threads use all cores
as processes would, but kernels are compiled or loaded only once. Trials of campaigns run in processes,
because their judges are Python code.
"""

import hashlib
import json
import os
import stat
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from hil.record import provenance
from hil.record.new_file import MOST_NOTE_BYTES, open_anew, write_anew
from hil.record.run_folder import open_taken_over, written_by_oneself
from tools.jobs import results
from tools.output import progress_console
from tools.progress import shown_progress

Task = TypeVar("Task")


@dataclass(frozen=True)
class Where:
    """Folder of the results, and the workers: threads on this machine, or the workers of a Dask scheduler."""

    out: Path
    workers: int | None = None
    scheduler: str | None = None


def paths_of(kind: str, tasks: Sequence[object], out: Path) -> list[Path]:
    """The files of pieces in a folder of results, whether they exist or not."""
    return [out / "pieces" / f"{kind}-{provenance.key(kind, task)[:20]}.json" for task in tasks]


def run(
    kind: str, piece: Callable[[Task], Any], tasks: Sequence[Task], where: Where, threads: bool = True
) -> list[Any]:
    """Compute the missing pieces and return the results of all in the order of `tasks`."""
    paths = paths_of(kind, tasks, where.out)
    stored = [read_stored(path, task) for path, task in zip(paths, tasks, strict=True)]
    found = {index: result for index, result in enumerate(stored) if result is not None}
    if found:
        progress_console.print(f"{kind}: {len(found)} of {len(tasks)} results taken over from {where.out}")
    missing = [index for index in range(len(tasks)) if index not in found]
    if missing:
        computed = results(
            piece, [tasks[index] for index in missing], where.workers, where.scheduler, threads
        )
        with shown_progress() as progress:
            for number, result in computed:
                index = missing[number]
                found[index] = result
                store(paths[index], tasks[index], result)
                progress(len(found) / len(tasks), f"{kind} {len(found)}/{len(tasks)}")
    return [found[index] for index in range(len(tasks))]


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages and the digest of the sources that compute a result."""
    return {**provenance.packages(), "sources": provenance.sources()[:16]}


def store(path: Path, task: object, result: Any) -> None:
    """Write a result with its task and versions."""
    with written_by_oneself():
        path.parent.mkdir(parents=True, exist_ok=True)
        content = {"task": repr(task), "versions": versions(), "digest": digest_of(result), "result": result}
        write_anew(path, json.dumps(content))


def digest_of(result: Any) -> str:
    """The digest of a result, the same before it is written and after it is read."""
    return hashlib.sha256(json.dumps(result).encode()).hexdigest()


def read_stored(path: Path, task: object) -> Any:
    """Return the result of a task in a file; None if there is none, or if the file is damaged.

    Raises RunFolderError for a file that another user may have written.
    """
    try:
        opened = open_taken_over(path, "remove it, or name another folder with --out")
    except FileNotFoundError:
        return None
    with opened as file:
        found = os.fstat(file.fileno())
        if stat.S_ISREG(found.st_mode) and found.st_size <= MOST_NOTE_BYTES:
            with suppress(ValueError, KeyError, TypeError, RecursionError):
                content = json.loads(file.read())
                stated = content["task"], content["versions"], content["digest"]
                if stated == (repr(task), versions(), digest_of(content["result"])):
                    return content["result"]
    progress_console.print(f"{path} is damaged, or of another task; it is computed anew", markup=False)
    return None


def write_table(path: Path, table: pa.Table, parameters: Mapping[str, Any]) -> None:
    """Write the table of a result as Parquet, with its parameters and the versions as metadata."""
    metadata = {"vibrohil": json.dumps({"parameters": parameters, "versions": versions()})}
    with open_anew(path) as file:
        pq.write_table(table.replace_schema_metadata(metadata), file, compression="zstd")
