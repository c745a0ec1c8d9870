"""A log read back: its columns, the traces it holds, hashes to compare by, and the repair of a cut one."""

import hashlib
import json
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from hil.rerun_program import RerunError, rerun
from hil.run_traces import NO_BUS, NO_RECORDS, BusLog, LogLoss, Records, RunTraces

TIMELINES = ("sim_time", "wall_time")
MEASURED = frozenset({"deadline_ns", "work_us", "wake_latency_us", "overruns"})
"""What the machine took; no two runs agree in it."""
ROW_ID = "rerun.controls.RowId"
FENCE = re.compile(r"\A```\w*\n(.*)\n```\Z", re.DOTALL)


def is_whole(path: Path) -> bool:
    """Whether a log can be read from its first message to its footer."""
    return rerun(["rrd", "verify", path]).returncode == 0


def repair(path: Path) -> bool:
    """Make a log whole that a kill cut short, in place; whether that was needed.

    Such a log lacks its footer and may end within a message. Raises where nothing can be read of it.
    """
    if is_whole(path):
        return False
    mended = path.with_name(f"{path.name}.mended")
    outcome = rerun(["rrd", "optimize", "--continue-on-error", path, "-o", mended])
    if outcome.returncode != 0 or not mended.exists():
        raise RerunError(f"{path} is cut and cannot be mended; rebuild it from the traces ({outcome.stderr})")
    mended.rename(path)
    return True


def tables(path: Path) -> dict[str, pa.Table]:
    """The rows of each entity in order of simulated time, one column a component; nothing static."""
    batches: dict[str, list[pa.RecordBatch]] = defaultdict(list)
    for chunk in RrdReader(path).stream().to_chunks():
        if not chunk.is_static:
            batches[chunk.entity_path].append(chunk.to_record_batch().drop_columns([ROW_ID]))
    merged = {}
    for entity, parts in batches.items():
        plain = [pa.table(part.columns, names=part.schema.names) for part in parts]
        table = pa.concat_tables(plain, promote_options="default")
        sim_ns = table["sim_time"].cast(pa.int64()).to_numpy()
        merged[entity] = table.take(pa.array(np.argsort(sim_ns, kind="stable")))
    return merged


def leaves(name: str, values: pa.Array) -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns within a column, flat, by dotted names."""
    if pa.types.is_list(values.type):
        yield from leaves(name, values.flatten())
    elif pa.types.is_struct(values.type):
        for field, inner in zip(values.type, values.flatten(), strict=True):
            yield from leaves(f"{name}.{field.name}" if name else field.name, inner)
    else:
        yield name, values.to_numpy(zero_copy_only=False)


def contiguous(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array."""
    whole = column.combine_chunks()
    return whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole


def records_of(table: pa.Table | None) -> Records:
    """The records that the log holds of a trace, as the trace itself gives them."""
    if table is None:
        return NO_RECORDS
    columns = dict(leaves("", contiguous(table["trace:record"])))
    records = np.zeros(table.num_rows, dtype=[(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        records[name] = values
    return records


def documents(path: Path) -> dict[str, str]:
    """The texts under `about/`, without their fences."""
    texts = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.is_static and chunk.entity_path.startswith("/about/"):
            text = chunk.to_record_batch().column("TextDocument:text")[0].as_py()[0]
            fenced = FENCE.match(text)
            texts[chunk.entity_path.removeprefix("/about/")] = fenced.group(1) if fenced else text
    return texts


def bus_of(table: pa.Table | None) -> BusLog:
    """The frames that the log holds."""
    if table is None:
        return NO_BUS
    payloads = tuple(contiguous(table["frame:data"]).flatten().to_pylist())
    return BusLog(
        t_s=contiguous(table["sim_time"]).cast(pa.int64()).to_numpy() / 1e9,
        can_id=contiguous(table["frame:can_id"]).flatten().to_numpy().astype(np.int64),
        length=np.array([len(payload) for payload in payloads], np.int64),
        payloads=payloads,
    )


def losses_of(table: pa.Table | None) -> list[LogLoss]:
    """When the recorder lost frames."""
    return [] if table is None else [LogLoss(**loss) for (loss,) in table["loss:record"].to_pylist()]


def read_traces(path: Path) -> RunTraces:
    """What `read_run` gives of a run folder, from its log alone."""
    by_entity, texts = tables(path), documents(path)
    return RunTraces(
        plant=records_of(by_entity.get("/plant")),
        firmware=records_of(by_entity.get("/firmware")),
        impacts=records_of(by_entity.get("/impacts/truth")),
        operator=records_of(by_entity.get("/operator")),
        bus=bus_of(by_entity.get("/can/raw")),
        run=json.loads(texts.get("run", "{}")),
        outcome=json.loads(texts.get("outcome", "{}")),
        scenario=tomllib.loads(texts.get("scenario", "")),
        losses=losses_of(by_entity.get("/can/lost")),
    )


def content_bytes(values: NDArray[Any]) -> bytes:
    """What a hash is taken of: the numbers' bytes, or text and blobs with their lengths."""
    if values.dtype != object:
        return values.tobytes()
    blobs = [value if isinstance(value, bytes) else str(value).encode() for value in values.tolist()]
    return b"".join(len(blob).to_bytes(4, "little") + blob for blob in blobs)


def column_hashes(path: Path) -> dict[str, str]:
    """A hash of each column on the simulated timeline, by `entity:column`, however the rows were chunked.

    Left out are the wall clock and what the machine took, so that two runs of one seed in lockstep agree.
    """
    hashes = {}
    for entity, table in tables(path).items():
        for name in table.column_names:
            if name in TIMELINES and name != "sim_time":
                continue
            for leaf, values in leaves(name, contiguous(table[name])):
                if leaf.rpartition(".")[2] in MEASURED:
                    continue
                hashes[f"{entity}:{leaf}"] = hashlib.sha256(content_bytes(values)).hexdigest()
    return hashes
