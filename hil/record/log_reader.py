"""Reads a log back: its tables and traces."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from hil.record.bus_load import BusLoad, load_from_log
from hil.record.candump import NO_BUS, Bus, BusLog
from hil.record.new_file import MOST_NOTE_BYTES
from hil.record.rrd.unpacked_size import count_chunks, most_unpacked_bytes
from hil.record.run_traces import NO_RECORDS, RunTraces
from hil.record.traces.precision import NS_PER_S, TIME
from hil.record.traces.stored_trace import Records, StoredColumns
from text_input import parse_toml

TIMELINES = ("sim_time", "wall_time")
MEASURED = frozenset({"deadline_ns", "work_us", "wake_latency_us", "overruns", "cpu_us"})
"""Columns that depend on the machine and therefore differ between runs."""
ROW_ID = "rerun.controls.RowId"
FENCE = re.compile(r"\A(```+)\w*\n(.*)\n\1\Z", re.DOTALL)


BYTES_A_VALUE = 4
"""Fewest bytes of a run's log for each of its values, unpacked, on average."""
LOAD = "/can/load"
RECORD = "trace:record"


def store_of(path: Path) -> Any:
    """A log's chunks, which are found once as long as the file does not change."""
    count_chunks(path)  # refuses what unpacks to too much
    file = path.stat()
    return _store_of(path, file.st_ino, file.st_size, file.st_mtime_ns)


@lru_cache(2)
def _store_of(path: Path, *_content: int) -> Any:
    return RrdReader(path).store()


def entities(path: Path) -> set[str]:
    """The entities of a log that have rows."""
    columns = store_of(path).schema().component_columns()
    return {column.entity_path for column in columns if not column.is_static}


def blocks(path: Path, entity: str) -> Iterator[pa.Table]:
    """Yield the rows of an entity in blocks, in the order of the file.

    Raises ValueError for a column of which any number of elements takes no room, for example null, and for
    more values than a run logs: a packed bit becomes a byte, and a number eight.
    """
    values, most = 0, most_unpacked_bytes(path) // BYTES_A_VALUE
    for chunk in store_of(path).stream().filter(content=entity):
        if not chunk.is_static:
            batch = chunk.to_record_batch().drop_columns([ROW_ID])
            for column in batch.schema:
                if not takes_room(column.type):
                    raise ValueError(
                        f"{column.name} is of type {column.type!s:.80}; a run logs no such column"
                    )
            values += sum(map(count_values, batch.columns))
            if values > most:
                raise ValueError(f"{entity} has more than {most} values; a log of this size has fewer")
            yield pa.table(batch.columns, names=batch.schema.names)


def takes_room(kind: pa.DataType) -> bool:
    """Whether each element of a type takes room in a file, so that the file's size limits their number."""
    inner = [kind.field(number).type for number in range(kind.num_fields)]
    if pa.types.is_struct(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_union(kind):
        return bool(inner) and all(map(takes_room, inner))
    if pa.types.is_fixed_size_binary(kind):
        return bool(kind.byte_width > 0)
    return bool(
        pa.types.is_primitive(kind)
        or pa.types.is_binary(kind)
        or pa.types.is_string(kind)
        or (pa.types.is_list(kind) and all(map(takes_room, inner)))
    )


def count_values(array: pa.Array) -> int:
    """The number of values in an array, each column of a struct by itself."""
    if pa.types.is_struct(array.type):
        return sum(map(count_values, array.flatten()))
    if pa.types.is_list(array.type) or pa.types.is_fixed_size_list(array.type):
        return len(array) + count_values(array.flatten())
    return len(array)


def join_in_order(parts: Iterable[pa.Table]) -> pa.Table:
    """Join blocks into one table, in order of simulated time."""
    table = pa.concat_tables(parts, promote_options="default")
    sim_ns = sim_ns_of(table)
    return table if rises(sim_ns) else table.take(pa.array(np.argsort(sim_ns, kind="stable")))


def rises(times: NDArray[Any]) -> bool:
    """Whether times never decrease."""
    return bool(np.all(times[1:] >= times[:-1]))


def sim_ns_of(table: pa.Table) -> NDArray[np.int64]:
    """The simulated time of each row in ns."""
    sim_ns: NDArray[np.int64] = contiguous(table["sim_time"]).cast(pa.int64()).to_numpy()
    return sim_ns


def names(path: Path) -> list[str]:
    """Names of the tables that can be read from a log."""
    return sorted(entities(path))


def table(path: Path, name: str) -> pa.Table:
    """The rows of an entity in order of simulated time, one column per component, without static data."""
    return join_in_order(blocks(path, name))


def ordered_blocks(path: Path, name: str) -> Iterator[pa.Table]:
    """Yield the rows of a table in blocks in order of time; in one block if the file is not in order."""
    times = [sim_ns_of(block)[[0, -1]] for block in blocks(path, name)]
    if not rises(np.concatenate(times)):
        yield table(path, name)
    else:
        yield from blocks(path, name)


def tables(path: Path) -> dict[str, pa.Table]:
    """All tables of a log."""
    return {name: table(path, name) for name in names(path)}


def contiguous(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array."""
    whole = column.combine_chunks()
    return whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole


def leaf(rows: pa.Table, component: str) -> pa.Array:
    """A component's values, one per row."""
    return contiguous(rows[component]).flatten()


def leaves(name: str, values: pa.Array) -> Iterator[tuple[str, pa.Array]]:
    """Yield the columns within a struct by dotted names; any other array is yielded as one column."""
    if not pa.types.is_struct(values.type):
        yield name, values
        return
    for field, inner in zip(values.type, values.flatten(), strict=True):
        yield from leaves(f"{name}.{field.name}" if name else field.name, inner)


def columns_of(rows: pa.Table) -> dict[str, NDArray[Any]]:
    """The logged columns of a trace, in the trace's own format."""
    found = leaves("", leaf(rows, RECORD))
    columns = {name: values.to_numpy(zero_copy_only=False) for name, values in found}
    return {TIME: sim_ns_of(rows) / NS_PER_S, **columns}


class LoggedTrace(StoredColumns):
    """A trace's records in a log."""

    def __init__(self, path: Path, entity: str) -> None:
        super().__init__()
        self._path = path
        self._entity = entity
        times = []
        for block in blocks(path, entity):
            columns = columns_of(block)
            times.append(columns[TIME])
        self.dtype = np.dtype([(name, values.dtype) for name, values in columns.items()])
        t_s = np.concatenate(times)
        self._rows = len(t_s)
        self._order = None if rises(t_s) else np.argsort(t_s, kind="stable")

    def __len__(self) -> int:
        return self._rows

    def _pieces(self, names: Sequence[str]) -> Iterator[list[NDArray[Any]]]:
        for block in blocks(self._path, self._entity):
            columns = columns_of(block)
            yield [columns[name] for name in names]

    def _column(self, name: str) -> NDArray[Any]:
        values = super()._column(name)
        return values if self._order is None else values[self._order]


class LoggedBus(Bus):
    """The bus in a log, which has its load alone; the frames stand in can.log."""

    def __init__(self, load: BusLoad) -> None:
        self.load = load

    def pieces(self) -> Iterator[BusLog]:
        """Yield no frames."""
        yield from ()


def documents(path: Path) -> dict[str, str]:
    """The texts under `about/`, without their fences; raises ValueError for one of unusual size."""
    texts = {}
    for chunk in store_of(path).stream().filter(content="/about/**"):
        if chunk.is_static:
            text = chunk.to_record_batch().column("TextDocument:text")[0].as_py()[0]
            if len(text) > MOST_NOTE_BYTES:
                raise ValueError(f"{chunk.entity_path} has {len(text)} characters")
            fenced = FENCE.match(text)
            texts[chunk.entity_path.removeprefix("/about/")] = fenced.group(2) if fenced else text
    return texts


def json_object(text: str) -> dict[str, Any]:
    """The JSON object in a text; raises ValueError for any other value."""
    content = json.loads(text)
    if not isinstance(content, dict):
        raise ValueError(f"{text:.40} is no JSON object")
    return content


def load_in(rows: pa.Table) -> BusLoad:
    """The load of the bus over time."""
    return load_from_log(sim_ns_of(rows) / NS_PER_S, leaf(rows, "Scalars:scalars").to_numpy())


def read_traces(path: Path) -> RunTraces:
    """Read the same `RunTraces` as `read_run` from the log alone; columns are read at first use."""
    known, texts = entities(path), documents(path)

    def records(entity: str) -> Records:
        return LoggedTrace(path, entity) if entity in known else NO_RECORDS

    return RunTraces(
        plant=records("/plant"),
        firmware=records("/firmware"),
        impacts=records("/impacts/truth"),
        operator=records("/operator"),
        bus=LoggedBus(load_in(table(path, LOAD))) if LOAD in known else NO_BUS,
        run=json_object(texts.get("run", "{}")),
        outcome=json_object(texts.get("outcome", "{}")),
        scenario=parse_toml(texts.get("scenario", "")),
        bus_errors=records("/bus_errors"),
    )
