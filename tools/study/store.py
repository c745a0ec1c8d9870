"""Results as Parquet files, one per piece of work, each with its inputs.

A piece's file appears only when it is complete, under a name made from its specification and the versions of
everything that it depends on: a study that was killed goes on where it stopped, and one whose sources changed
starts afresh.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from plant_sim.kernels import cache_folder

Spec = Mapping[str, Any]

METADATA_KEY = b"vibrohil"


@cache
def versions() -> dict[str, str]:
    """What computed a result: packages, and the state of the plant's and the studies' own sources."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    for source in sorted(here.rglob("*.py")):
        digest.update(source.relative_to(here).as_posix().encode())
        digest.update(source.read_bytes())
    packages = {name: version(name) for name in ("vibrohil", "numpy", "numba", "pyarrow")}
    return {**packages, "plant_sim": cache_folder().name.split("-")[-1], "studies": digest.hexdigest()[:16]}


def name_of(kind: str, spec: Spec) -> str:
    """A file's name: the kind of piece and a hash of all that its content depends on."""
    text = json.dumps({"kind": kind, "spec": spec, "versions": versions()}, sort_keys=True)
    return f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:20]}.parquet"


def write(path: Path, table: pa.Table, spec: Spec, facts: Mapping[str, Any]) -> None:
    """Write a table with its specification, versions and what else was found; all of it or nothing."""
    metadata = {"spec": spec, "versions": versions(), "facts": facts}
    tagged = table.replace_schema_metadata({METADATA_KEY: json.dumps(metadata, sort_keys=True)})
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    pq.write_table(tagged, partial, compression="zstd")
    partial.replace(path)


def read(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """A table and its `spec`, `versions` and `facts`."""
    table = pq.read_table(path)
    return table, json.loads(table.schema.metadata[METADATA_KEY])


def is_complete(path: Path) -> bool:
    """Whether the file is there and whole; one that is damaged is removed."""
    if not path.exists():
        return False
    try:
        pq.read_metadata(path)
    except pa.ArrowInvalid:
        path.unlink()
        return False
    return True
