"""The frames of a run for other programs: all signals of `vibro.dbc`, counters and CRCs too, with units.

mf4      ASAM MDF 4: a channel group for each frame, by asammdf
mcap     a topic for each frame, messages in JSON, units in its JSON schema, by mcap
parquet  a folder with a file for each frame, units in the fields' metadata
csv      a folder with a file for each frame, units in the header
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from cantools.database.can import Message
from numpy.typing import NDArray
from pyarrow import parquet

from firmware_py.interface.dbc import database
from hil.record.frame_tables import table_of
from hil.record.new_file import open_anew
from hil.runs.recorded_run import Run
from tools.exchange.csv_table import write_csv
from tools.output import BadInputError

CAN = "can/"


class DecodedFrames(NamedTuple):
    """All frames of one name: seconds from the run's start, wall clock in ns, and signals of shape (n,)."""

    name: str
    t_s: NDArray[np.float64]
    wall_ns: NDArray[np.int64]
    signals: Mapping[str, NDArray[np.generic]]
    units: Mapping[str, str]


def decode(run: Run) -> Iterator[DecodedFrames]:
    """The frames of a run's can.log that have signals, grouped by name; BadInputError if there are none."""
    names = {table.removeprefix(CAN) for table in run.names if table.startswith(CAN)}
    known = [message for message in database().messages if message.name in names and message.signals]
    if not known:
        raise BadInputError(
            f"{run.folder} has no frame of vibro.dbc in a can.log; run or import something with a bus"
        )
    frames = run.frames.whole()
    return (frames_of(table_of(frames, f"{CAN}{one.name}", run.wall_start_s), one) for one in known)


def frames_of(table: pa.Table, message: Message) -> DecodedFrames:
    """The frames of one name with their units."""
    units = {signal.name: signal.unit or "" for signal in message.signals}
    wall_ns = table["wall_time"].cast(pa.int64()).to_numpy()
    signals = {name: table[name].to_numpy() for name in table.column_names if name in units}
    return DecodedFrames(message.name, table["t_s"].to_numpy(), wall_ns, signals, units)


def write_mf4(frames: Iterable[DecodedFrames], path: Path) -> None:
    """Write one MDF file; asammdf would write any other name than `….mf4` with that ending instead."""
    from asammdf import MDF, Signal

    with TemporaryDirectory(dir=path.parent, prefix=".vibrohil-") as folder, MDF(version="4.10") as file:
        for number, one in enumerate(frames):
            if number == 0:
                file.start_time = datetime.fromtimestamp(one.wall_ns[0] * 1e-9 - one.t_s[0], UTC)
            signals = [
                Signal(values, one.t_s, name=f"{one.name}.{name}", unit=one.units[name])
                for name, values in one.signals.items()
            ]
            file.append(signals, acq_name=one.name, comment=f"frame {one.name} of vibro.dbc")
        written = file.save(Path(folder) / "frames.mf4")
        written.rename(path)


def write_mcap(frames: Iterable[DecodedFrames], path: Path) -> None:
    """Write one MCAP file, its messages in order of time within each topic."""
    from mcap.writer import Writer

    with open_anew(path) as stream:
        writer = Writer(stream)
        writer.start(library="vibrohil")
        for one in frames:
            properties = {name: {"type": "number", "unit": one.units[name]} for name in one.signals}
            schema = json.dumps({"type": "object", "title": one.name, "properties": properties})
            schema_id = writer.register_schema(one.name, "jsonschema", schema.encode())
            channel_id = writer.register_channel(f"/{CAN}{one.name}", "json", schema_id)
            columns = [values.tolist() for values in one.signals.values()]
            for wall_ns, *row in zip(one.wall_ns.tolist(), *columns, strict=True):
                data = json.dumps(dict(zip(one.signals, row, strict=True))).encode()
                writer.add_message(channel_id, wall_ns, data, wall_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this


def write_parquet(frames: Iterable[DecodedFrames], folder: Path) -> None:
    """Write a file for each frame; a field's metadata holds its `unit`."""
    folder.mkdir(parents=True, exist_ok=True)
    for one in frames:
        units = {"t_s": "s", "wall_time": "", **one.units}
        wall_time = one.wall_ns.astype("datetime64[ns]")
        table = pa.table({"t_s": one.t_s, "wall_time": wall_time, **one.signals})
        fields = [field.with_metadata({"unit": units[field.name]}) for field in table.schema]
        with open_anew(folder / f"{one.name}.parquet") as file:
            parquet.write_table(table.cast(pa.schema(fields)), file)


def write_csv_files(frames: Iterable[DecodedFrames], folder: Path) -> None:
    """Write a file for each frame; the title of a column is `name [unit]`."""
    folder.mkdir(parents=True, exist_ok=True)
    for one in frames:
        units = {"t_s": "s", **one.units}
        columns = {"t_s": one.t_s, **one.signals}
        titles = [f"{name} [{units[name]}]" if units[name] else name for name in columns]
        write_csv(pa.table(columns).rename_columns(titles), folder / f"{one.name}.csv")


FORMATS: Mapping[str, Callable[[Iterable[DecodedFrames], Path], None]] = {
    "mf4": write_mf4,
    "mcap": write_mcap,
    "parquet": write_parquet,
    "csv": write_csv_files,
}


def export(run: Run, kind: str, out: Path) -> dict[str, int]:
    """Write the frames of `run` to `out`, a file or a folder by `kind`; return their number by name."""
    counts: dict[str, int] = {}

    def counting(frames: Iterable[DecodedFrames]) -> Iterator[DecodedFrames]:
        for one in frames:
            counts[one.name] = len(one.t_s)
            yield one

    frames = counting(decode(run))
    try:
        FORMATS[kind](frames, out)
    except ModuleNotFoundError as error:
        raise BadInputError(
            f"--to {kind} needs the package {error.name}; install it with `pip install 'vibrohil[export]'`"
        ) from error
    return counts
