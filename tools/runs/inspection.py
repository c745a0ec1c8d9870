"""Extracts from a recorded run: tables as files, signals as a plot."""

from pathlib import Path

import pyarrow as pa
from pyarrow import feather, parquet

from firmware_py.builds.a2l import unit_of
from hil.record.new_file import open_anew
from hil.runs.recorded_run import Run
from tools.exchange.csv_table import write_csv
from tools.output import BadInputError
from tools.plots import drawn

DEFAULT_SIGNALS = (
    "plant.x_m",
    "firmware.state.estimator.x_m",
    "plant.omega_rad_s",
    "firmware.outputs.torque_n_m",
)
"""The default signals of a plot, as far as a log has them: an imported log has no truth."""


def default_signals(run: Run) -> list[str]:
    """The default signals of a plot of this log. Raises BadInputError if it has none of them."""
    found = [one for one in DEFAULT_SIGNALS if one.partition(".")[0] in run.names]
    if not found:
        raise BadInputError(
            f"the log has no signals of plant or firmware to plot; name others by --signal TABLE.COLUMN, of "
            f"{', '.join(run.names) or 'no table'}"
        )
    return found


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table to a file ending in one of `tools.commands.places.TABLES`."""
    kind = path.suffix.lower()
    if kind == ".csv":
        write_csv(table, path)
        return
    with open_anew(path) as file:
        if kind == ".parquet":
            parquet.write_table(table, file)
        else:
            feather.write_feather(table, file, compression="uncompressed")


def plot_signals(run: Run, signals: list[str], path: Path) -> None:
    """Draw signals one below the other over time, with their units; the file's ending gives the format."""
    found = {name: run.signal(name) for name in signals}
    for name, (_, values) in found.items():
        if values.dtype.kind not in "bifu":
            raise BadInputError(f"signal {name!r} holds no numbers; see it as a table with --table")
    with drawn(path, 12.0, 1.0 + 1.9 * len(found)) as figure:
        panels = figure.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, (t_s, values)) in zip(panels, found.items(), strict=True):
            axes.plot(t_s, values, lw=0.8)
            axes.set_title(name, loc="left", fontsize=9)
            axes.set_ylabel(unit_of(name).replace("^2", "²"))
        panels[-1].set_xlabel("time [s]")
        figure.align_ylabels()
