"""A hash of each column of a log, to compare two logs by."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
from numpy.typing import NDArray

from hil.record.log_reader import MEASURED, TIMELINES, contiguous, leaves, names, table


def content_bytes(values: NDArray[Any]) -> bytes:
    """What a hash is taken of: the numbers' bytes, or text and blobs with their lengths."""
    if values.dtype != object:
        return values.tobytes()
    blobs = [value if isinstance(value, bytes) else str(value).encode() for value in values.tolist()]
    return b"".join(len(blob).to_bytes(4, "little") + blob for blob in blobs)


def differing_entities(live: Mapping[str, str], whole: Mapping[str, str]) -> set[str]:
    """The entities of a whole log that one written during the run lacks or has otherwise.

    Left out are those that only the conclusion writes: names of states that fit, and limits of checks.
    """
    differing = {name.split(":")[0] for name in whole if live.get(name) != whole[name]}
    return {entity for entity in differing if not entity.startswith(("/timeline/", "/limits/", "/held"))}


def column_hashes(path: Path) -> dict[str, str]:
    """A hash of each column on the simulated timeline, by `entity:column`, however the rows were chunked.

    Left out are the wall clock and what the machine took, so that two runs of one seed in lockstep agree.
    """
    hashes = {}
    for entity in names(path):
        rows = table(path, entity)
        for name in rows.column_names:
            if name in TIMELINES and name != "sim_time":
                continue
            whole = contiguous(rows[name])
            for column, values in leaves(name, whole.flatten() if pa.types.is_list(whole.type) else whole):
                if column.rpartition(".")[2] in MEASURED:
                    continue
                content = content_bytes(values.to_numpy(zero_copy_only=False))
                hashes[f"{entity}:{column}"] = hashlib.sha256(content).hexdigest()
    return hashes
