"""Two runs side by side: the figures of both, and the first moment at which a signal differs.

Signals are compared on simulated time, record by record and bit by bit as logged; measured times of the
machine are left out. Frames are compared if both runs have their can.log, unless one was in strict real time:
the frames of such a run have the times of their reception.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from hil.figures.records import CATALOGUE, Origin, value_of
from hil.judge.tolerance import Tolerance, tolerance_of
from hil.record.damage import reading
from hil.record.frame_tables import RAW
from hil.record.log_reader import MEASURED
from hil.record.run_traces import column, pair_by_tick
from hil.record.state_timeline import ALARM, OTHER
from hil.runs.recorded_run import Run
from hil.scenario.checks import size_of
from hil.show.layout import overlay
from hil.show.log_stream import colors, recorded
from plant_sim.arrays import FloatArray
from tools.output import BadInputError

TRACES = ("operator", "plant", "impacts/truth", "firmware")
"""The compared traces, in the order of cause and effect within one tick."""
TICKED = ("operator", "plant", "firmware")
ENDS = frozenset(f"{name}.t_s" for name in TICKED)
"""Signals of a first difference which say that one run ends earlier; its values are the ends."""
NOT_COMPARED = ("t_s", "wall_time")
SIDES = ("a", "b")


class Difference(NamedTuple):
    """The first moment at which two runs differ, and the value of each there; None for a missing value."""

    t_s: float
    signal: str
    a: Any
    b: Any


def are_alike(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask, shape (n,), of the rows in which two columns of the same length are equal; NaN equals NaN."""
    same: NDArray[np.bool_] = np.asarray(a == b, bool)
    if a.dtype.kind == "f" and b.dtype.kind == "f":
        same = same | (np.isnan(a) & np.isnan(b))
    return same


def cell(values: NDArray[Any], row: int) -> Any:
    """One value for JSON: bytes become hexadecimal text; None for a row past the end."""
    if row >= len(values):
        return None
    value = values[row]
    return value.hex() if isinstance(value, bytes) else value


def first_in_table(name: str, table_a: pa.Table, table_b: pa.Table) -> Difference | None:
    """The first difference within one table.

    Ticks are paired by their time, so that a tick that a loop skipped does not count as a difference. The
    rows of other tables are paired in order, and a difference of their times counts.
    """
    t_a, t_b = table_a["t_s"].to_numpy(), table_b["t_s"].to_numpy()
    found: Difference | None = None
    if name in TICKED:
        shared_s, rows_a, rows_b = np.intersect1d(t_a, t_b, return_indices=True)
        if t_a[-1] != t_b[-1]:
            found = Difference(float(min(t_a[-1], t_b[-1])), f"{name}.t_s", float(t_a[-1]), float(t_b[-1]))
    else:
        paired = min(len(t_a), len(t_b))
        unlike = np.flatnonzero(t_a[:paired] != t_b[:paired])
        paired = int(unlike[0]) if len(unlike) else paired
        rows_a = rows_b = np.arange(paired)
        shared_s = t_a[:paired]
        if paired < max(len(t_a), len(t_b)):
            times = cell(t_a, paired), cell(t_b, paired)
            found = Difference(float(min(t for t in times if t is not None)), f"{name}.t_s", *times)
    for signal in table_a.column_names:
        if (
            signal in NOT_COMPARED
            or signal.rpartition(".")[2] in MEASURED
            or signal not in table_b.column_names
        ):
            continue
        values_a, values_b = table_a[signal].to_numpy()[rows_a], table_b[signal].to_numpy()[rows_b]
        unlike = np.flatnonzero(~are_alike(values_a, values_b))
        if len(unlike) and (found is None or shared_s[unlike[0]] < found.t_s):
            row = int(unlike[0])
            found = Difference(
                float(shared_s[row]), f"{name}.{signal}", cell(values_a, row), cell(values_b, row)
            )
    return found


def pair_blocks(
    blocks_a: Iterable[pa.Table], blocks_b: Iterable[pa.Table], by_time: bool
) -> Iterator[tuple[pa.Table, pa.Table]]:
    """Corresponding parts of two tables, one after the other; all but the last end with a common row.

    Common rows have the same time or the same number. The next part begins with this row, so that no part is
    empty.
    """
    left_a, left_b = iter(blocks_a), iter(blocks_b)
    a, b = next(left_a), next(left_b)
    while True:
        more_a, more_b = next(left_a, None), next(left_b, None)
        if more_a is None and more_b is None:
            yield a, b
            return
        if by_time:
            times = a["t_s"].to_numpy(), b["t_s"].to_numpy()
            _, rows_a, rows_b = np.intersect1d(*times, return_indices=True)
        else:
            rows_a = rows_b = np.arange(min(a.num_rows, b.num_rows))
        if len(rows_a):
            last_a, last_b = int(rows_a[-1]), int(rows_b[-1])
            yield a.slice(0, last_a + 1), b.slice(0, last_b + 1)
            a, b = a.slice(last_a), b.slice(last_b)
        a = a if more_a is None else pa.concat_tables([a, more_a])
        b = b if more_b is None else pa.concat_tables([b, more_b])


def first_in_blocks(
    name: str, blocks_a: Iterable[pa.Table], blocks_b: Iterable[pa.Table]
) -> Difference | None:
    """The first difference within one table, which is read in blocks."""
    parts = pair_blocks(blocks_a, blocks_b, name in TICKED)
    found = (first_in_table(name, part_a, part_b) for part_a, part_b in parts)
    return next((difference for difference in found if difference is not None), None)


def first_difference(a: Run, b: Run) -> Difference | None:
    """The first difference of two runs; of simultaneous differences the first in the order of TRACES."""
    names = [name for name in TRACES if name in a.names or name in b.names]
    notes = (run.traces.run for run in (a, b))
    if not any(note.get("clock") == "real" and note.get("time") != "held" for note in notes):
        names += [RAW] * (RAW in a.names or RAW in b.names)
    if not names:
        raise BadInputError(f"{a.log} and {b.log} hold neither traces nor frames to compare")
    found: Difference | None = None
    for name in names:
        if name in a.names and name in b.names:
            with reading(a.log, f"or {b.log} is; `vibrohil inspect` reads each alone"):
                difference = first_in_blocks(name, a.blocks(name), b.blocks(name))
        else:
            present = a if name in a.names else b
            rows = present.table(name).num_rows
            counts = (rows, None) if present is a else (None, rows)
            difference = Difference(float(present.table(name)["t_s"][0].as_py()), name, *counts)
        if difference is not None and (found is None or difference.t_s < found.t_s):
            found = difference
    return found


def figures_side_by_side(a: Run, b: Run) -> dict[str, dict[str, Any]]:
    """Every figure of both runs, by dotted name: a, b, b − a if both are numbers, and the unit."""
    rows = {}
    for spec in CATALOGUE.values():
        value_a, value_b = (value_of(run.figures, spec.name) for run in (a, b))
        numbers = all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in (value_a, value_b)
        )
        change = value_b - value_a if numbers else None
        rows[spec.name] = {"a": value_a, "b": value_b, "change": change, "unit": spec.unit}
    return rows


def is_timing(name: str) -> bool:
    """Whether a figure depends on the machine, so that it differs from run to run."""
    return CATALOGUE[name].origin is Origin.TIMING


def flips_of(a: Run, b: Run) -> list[dict[str, Any]]:
    """The checks that both runs have and that only one has passed; those that b has not passed come first."""
    of_a = {(check["name"], check["limit"]): check for check in a.verdict.get("checks", [])}
    flips = []
    for check in b.verdict.get("checks", []):
        other = of_a.get((check["name"], check["limit"]))
        if other is not None and other["passed"] != check["passed"]:
            same = {key: check[key] for key in ("name", "limit", "unit")}
            flips.append(
                same
                | {
                    "a": other["passed"],
                    "b": check["passed"],
                    "value_a": other["value"],
                    "value_b": check["value"],
                }
            )
    return sorted(flips, key=lambda one: one["b"] is True)


def largest_changes(
    figures: Mapping[str, Mapping[str, Any]], tolerances: Mapping[str, Tolerance] | None = None
) -> list[str]:
    """The figures beyond their tolerance: texts and missing ones first, then by their change.

    A change is relative to the larger value, or to a requirement's limit if that is larger still: a residual
    that rises tenfold far below its limit means little. Timing comes last.
    """

    def size(name: str) -> float:
        row = figures[name]
        if row["change"] is None:
            return math.inf
        return float(abs(row["change"]) / max(abs(row["a"]), abs(row["b"]), size_of(name)))

    differing = [
        name
        for name, row in figures.items()
        if not tolerance_of(tolerances or {}, name).holds(row["a"], row["b"])
    ]
    return sorted(differing, key=lambda name: (is_timing(name), -size(name)))


def compare(a: Run, b: Run, tolerances: Mapping[str, Tolerance] | None = None) -> dict[str, Any]:
    """The changed verdicts, both runs' figures, whether all signals are equal, and the first difference.

    `within_tolerance`: no verdict differs, and every figure of the module is within its tolerance.
    """
    difference = first_difference(a, b)
    figures = figures_side_by_side(a, b)
    flips = flips_of(a, b)
    beyond = largest_changes(figures, tolerances)
    return {
        "a": str(a.log),
        "b": str(b.log),
        "equal": difference is None,
        "first_difference": None if difference is None else difference._asdict(),
        "flips": flips,
        "figures": figures,
        "largest_changes": beyond,
        "within_tolerance": not flips
        and a.verdict["passed"] == b.verdict["passed"]
        and all(map(is_timing, beyond)),
        "passed": {side: run.verdict["passed"] for side, run in zip(SIDES, (a, b), strict=True)},
        "verdict": {side: run.verdict["verdict"] for side, run in zip(SIDES, (a, b), strict=True)},
    }


def position_and_speed_apart(a: Run, b: Run) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """True position in mm and crank speed in rad/s, b minus a at their common ticks: name, s, values."""
    first, second = pair_by_tick(a.traces.plant, b.traces.plant)
    t_s = column(first, "t_s")
    for name, source, factor in (("x_mm", "x_m", 1e3), ("omega_rad_s", "omega_rad_s", 1.0)):
        apart = factor * (column(second, source) - column(first, source))
        if len(apart):
            yield name, t_s, apart


def write_overlay(a: Run, b: Run, difference: Difference | None, path: Path) -> None:
    """Write both runs into one recording, under /a and /b, with plots of both and of b − a."""
    name = f"{a.log.parent.name} (a), {b.log.parent.name} (b)"
    layout = overlay(None if difference is None else difference.t_s)
    needed_bytes = 2 * sum(run.log.stat().st_size for run in (a, b))
    with recorded(path, name, layout, needed_bytes) as recording:
        for side, run in zip(SIDES, (a, b), strict=True):
            for chunk in RrdReader(run.log).store().stream():
                if not chunk.entity_path.startswith("/__"):
                    recording.send_chunks([chunk.with_entity_path(f"/{side}{chunk.entity_path}")])
        for name, t_s, values in position_and_speed_apart(a, b):
            entity = f"b_minus_a/{name}"
            style = rr.SeriesLines(names=["b − a"], colors=colors([OTHER]), widths=[1.2])
            recording.log(entity, style, static=True)
            recording.send_columns(
                entity, [rr.TimeColumn("sim_time", duration=t_s)], rr.Scalars.columns(scalars=values)
            )
        if difference is not None:
            text = f"first difference: {difference.signal}"
            recording.log(
                "difference", rr.StateConfiguration(values=[text], colors=colors([ALARM])), static=True
            )
            time = rr.TimeColumn("sim_time", duration=np.array([difference.t_s]))
            recording.send_columns("difference", [time], [*rr.StateChange.columns(state=[text])])
