"""Results as Parquet files, one per piece of work, each with its inputs.

A piece's file appears only when it is complete, under a name made from its specification and the versions of
everything that it depends on: a study that was killed goes on where it stopped, and one whose sources changed
starts afresh.
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
    """What computed a result: the packages and the code's state."""
    return {**provenance.packages(), "sources": provenance.sources()[:16]}


def name_of(kind: str, spec: Spec) -> str:
    """A file's name: the kind of piece and a hash of all that its content depends on."""
    return f"{kind}-{provenance.key(kind, json.dumps(spec, sort_keys=True))[:20]}.parquet"


def columns(names: str, texts: str = "", counts: str = "") -> pa.Schema:
    """A table's columns in order; `texts` of them hold strings, `counts` whole numbers, the others floats."""
    kinds = dict.fromkeys(texts.split(), pa.string()) | dict.fromkeys(counts.split(), pa.int64())
    return pa.schema([(name, kinds.get(name, pa.float64())) for name in names.split()])


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
