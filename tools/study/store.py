"""Results as Parquet files, one for each piece of work, each with its inputs.

A file is created only once its piece is complete. Its name is made from the piece's specification and the
versions of everything on which it depends. A killed study therefore continues where it stopped, and a study
whose sources have changed starts again.
"""

import json
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from hil.record import provenance

Spec = Mapping[str, Any]

METADATA_KEY = b"vibrohil"


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages and the digest of the sources that compute a result."""
    return {**provenance.packages(), "sources": provenance.sources()[:16]}


def name_of(kind: str, spec: Spec) -> str:
    """Return a file's name: the kind of piece and a digest of everything on which its content depends."""
    return f"{kind}-{provenance.key(kind, json.dumps(spec, sort_keys=True))[:20]}.parquet"


def write(path: Path, table: pa.Table, spec: Spec, facts: Mapping[str, Any]) -> None:
    """Write a table with its specification, versions and facts atomically."""
    metadata = {"spec": spec, "versions": versions(), "facts": facts}
    tagged = table.replace_schema_metadata({METADATA_KEY: json.dumps(metadata, sort_keys=True)})
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    pq.write_table(tagged, partial, compression="zstd")
    partial.replace(path)


def read(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """Return a table and its metadata: `spec`, `versions` and `facts`."""
    table = pq.read_table(path)
    return table, json.loads(table.schema.metadata[METADATA_KEY])


def is_complete(path: Path) -> bool:
    """Return whether the file exists and is complete; a damaged file is removed."""
    if not path.exists():
        return False
    try:
        pq.read_metadata(path)
    except pa.ArrowInvalid:
        path.unlink()
        return False
    return True
