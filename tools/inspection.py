"""A run read back from its log alone: tables, figures and plots.

>>> from pathlib import Path
>>> open_run(Path("runs/nowhere.rrd"))
Traceback (most recent call last):
tools.output.BadInputError: runs/nowhere.rrd is not there; name a run folder or an .rrd file

In one line: `open_run("runs/mine").table("plant").to_pandas()` where pandas is installed.
"""

import difflib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, feather, parquet

from hil import rundir
from hil.figure_records import Figures
from hil.figures import figures_from
from hil.log_reader import TIMELINES, contiguous, read_traces, tables
from hil.run_traces import RunTraces
from tools.output import BadInputError
from tools.view import log_of

WRITERS = (".parquet", ".csv", ".arrow")
DEFAULT_SIGNALS = (
    "plant.x_m",
    "firmware.state.estimator.x_m",
    "plant.omega_rad_s",
    "firmware.outputs.torque_n_m",
)
"""What a plot shows where nothing is named."""


def named(name: str, among: list[str], what: str) -> str:
    """`name` if it is there, else an error that says which ones come near."""
    if name in among:
        return name
    near = ", ".join(difflib.get_close_matches(name, among, n=3, cutoff=0.4)) or ", ".join(among)
    raise BadInputError(f"no {what} {name!r} in this log; it has {near}")


def single(values: pa.Array) -> pa.Array:
    """A component's column with its lists of one taken out; longer lists stay."""
    if not pa.types.is_list(values.type) or values.null_count:
        return values
    lengths = np.diff(values.offsets.to_numpy())
    return values.flatten() if bool(np.all(lengths == 1)) else values


def columns_of(name: str, values: pa.Array) -> list[tuple[str, pa.Array]]:
    """The columns within a struct, by dotted names; any other array is its own."""
    if not pa.types.is_struct(values.type):
        return [(name, values)]
    found: list[tuple[str, pa.Array]] = []
    for field, inner in zip(values.type, values.flatten(), strict=True):
        found += columns_of(f"{name}.{field.name}" if name else field.name, inner)
    return found


def flat(table: pa.Table) -> pa.Table:
    """One entity's rows with a plain column a signal; `t_s` is simulated time in seconds."""
    seconds = contiguous(table["sim_time"]).cast(pa.int64()).to_numpy() / 1e9
    columns: dict[str, pa.Array] = {"t_s": pa.array(seconds), "wall_time": contiguous(table["wall_time"])}
    for component in table.column_names:
        if component in TIMELINES:
            continue
        short = component.rpartition(":")[2]
        for name, values in columns_of(
            "" if short == "record" else short, single(contiguous(table[component]))
        ):
            columns[name] = values
    return pa.table(columns)


@dataclass(frozen=True)
class LoggedRun:
    """One run's log; what is asked for is read once."""

    log: Path

    @cached_property
    def _tables(self) -> dict[str, pa.Table]:
        return {entity.removeprefix("/"): table for entity, table in tables(self.log).items()}

    @property
    def names(self) -> list[str]:
        """The tables there are: `plant`, `firmware`, `impacts/truth`, `can/Accelerometer`, …"""
        return sorted(self._tables)

    def table(self, name: str) -> pa.Table:
        """One table, a row a tick (an impact, a frame, an event), a column a signal."""
        return flat(self._tables[named(name, self.names, "table")])

    def signal(self, name: str) -> tuple[Any, Any]:
        """Simulated seconds and values of `TABLE.COLUMN`, both of shape (n,)."""
        prefixes = [entity for entity in self.names if name.startswith(f"{entity}.")]
        if not prefixes:
            raise BadInputError(
                f"signal {name!r} names no table; wanted TABLE.COLUMN with one of {', '.join(self.names)}"
            )
        entity = max(prefixes, key=len)
        table = self.table(entity)
        column = named(name.removeprefix(f"{entity}."), table.column_names, f"column of {entity}")
        return table["t_s"].to_numpy(), table[column].to_numpy()

    @cached_property
    def traces(self) -> RunTraces:
        """What the run folder's traces held."""
        return read_traces(self.log)

    @cached_property
    def figures(self) -> Figures:
        """All figures, computed anew."""
        return figures_from(self.traces)

    @cached_property
    def verdict(self) -> dict[str, Any]:
        """The verdict, computed anew: the keys of `verdict.json`."""
        return rundir.judge(self.traces, self.figures, self.log.parent)[0]


def open_run(run: str | Path | None = None) -> LoggedRun:
    """A run by its folder or .rrd file, the newest one without a name; a log cut by a kill is mended."""
    return LoggedRun(log_of(None if run is None else Path(run)))


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table as its file's ending says."""
    if path.suffix not in WRITERS:
        raise BadInputError(f"--to {path}: its ending says no format; end it in {', '.join(WRITERS)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".parquet":
        parquet.write_table(table, path)
    elif path.suffix == ".arrow":
        feather.write_feather(table, path, compression="uncompressed")
    else:
        csv.write_csv(as_text(table), path)


def as_text(table: pa.Table) -> pa.Table:
    """A table whose columns CSV can hold: bytes in hexadecimal."""
    columns = {}
    for name in table.column_names:
        values = table[name]
        if pa.types.is_nested(values.type):
            raise BadInputError(f"column {name!r} holds several numbers a row; write .parquet or .arrow")
        if pa.types.is_binary(values.type):
            values = pa.array([blob.hex() for blob in values.to_pylist()])
        columns[name] = values
    return pa.table(columns)


def plot_signals(run: LoggedRun, signals: list[str], path: Path) -> None:
    """Draw signals below each other over simulated time; the file's ending gives the format."""
    from matplotlib.figure import Figure

    drawn = [(name, *run.signal(name)) for name in signals]
    figure = Figure(figsize=(12.0, 1.0 + 1.9 * len(drawn)), layout="constrained")
    if path.suffix.removeprefix(".") not in figure.canvas.get_supported_filetypes():
        raise BadInputError(f"--plot {path}: its ending says no format; end it in .png, .svg or .pdf")
    for axes, (name, t_s, values) in zip(
        figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0], drawn, strict=True
    ):
        if values.dtype.kind not in "bifu":
            raise BadInputError(f"signal {name!r} holds no numbers; see it as a table with --table")
        axes.plot(t_s, values, lw=0.8)
        axes.set_title(name, loc="left", fontsize=9)
        axes.grid(alpha=0.3)
    axes.set_xlabel("simulated time [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
