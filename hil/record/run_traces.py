"""Reads the traces of a run folder, the source of figures, log and report."""

import difflib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hil.record.candump import NO_BUS, Bus, BusLog, StoredBus
from hil.record.damage import DamagedFileError, reading
from hil.record.traces.precision import TICKED
from hil.record.traces.stored_trace import PIECE_RECORDS, Records, StoredTrace
from hil.run_files import OTHER_TRACES, TRACES, RunFile, trace_file
from plant_sim.arrays import FloatArray
from text_input import parse_toml

NO_RECORDS: Records = np.zeros(0, dtype=[])


@dataclass(frozen=True)
class RunTraces:
    """All records of a run. A trace that was never written is an empty array without columns."""

    plant: Records = field(default_factory=lambda: NO_RECORDS)
    firmware: Records = field(default_factory=lambda: NO_RECORDS)
    impacts: Records = field(default_factory=lambda: NO_RECORDS)
    operator: Records = field(default_factory=lambda: NO_RECORDS)
    bus: Bus = NO_BUS
    run: Mapping[str, Any] = field(default_factory=dict)
    outcome: Mapping[str, Any] = field(default_factory=dict)
    scenario: Mapping[str, Any] = field(default_factory=dict)
    bus_errors: Records = field(default_factory=lambda: NO_RECORDS)
    """Error counters of a modelled bus, one record per change."""
    others: Mapping[str, Records] = field(default_factory=dict)
    """The records of `OTHER_TRACES`."""
    damage: Sequence[str] = ()
    """A sentence for each damaged file."""

    @property
    def is_worn(self) -> bool:
        """Whether the scene has a wearer."""
        return "wearer" in self.scenario.get("scene", {})

    @property
    def is_walked(self) -> bool:
        """Whether the scene has a gait."""
        return "gait" in self.scenario.get("scene", {})


NOTHING_LEFT = RunTraces()
"""The traces of a run without any record."""


def column(records: Records, name: str) -> FloatArray:
    """One column as floats; empty for an empty trace. Raises KeyError for an unknown name."""
    names = records.dtype.names or ()
    if name in names:
        return np.asarray(records[name], dtype=np.float64)
    if len(records) == 0:
        return np.zeros(0)
    near = ", ".join(difflib.get_close_matches(name, names, n=3)) or ", ".join(names)
    raise KeyError(f"the trace has no column {name!r}; it has {near}")


def pair_by_tick(first: Records, second: Records) -> tuple[Records, Records]:
    """The records of two traces at the ticks that both have; of a repeated tick the first."""
    ticks = column(first, "tick"), column(second, "tick")
    _, of_first, of_second = np.intersect1d(*ticks, return_indices=True)
    return first[of_first], second[of_second]


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object; empty if the file does not exist. Raises DamagedFileError for other content."""
    if not path.exists():
        return {}
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise DamagedFileError(f"{path} is damaged: it holds no JSON object")
    return content


def read_trace(path: Path) -> Records:
    """A trace; empty if its process never wrote it."""
    return StoredTrace(path, exact=path.stem not in TICKED) if path.exists() else NO_RECORDS


def pieces(traces: RunTraces) -> Iterator[RunTraces]:
    """Yield the run in pieces: records in memory, all cut at the same times, and then the frames."""
    ticked = max((traces.plant, traces.firmware), key=len)
    edges_s = accumulate_times(ticked)[PIECE_RECORDS::PIECE_RECORDS]
    records = {name: getattr(traces, name) for name in TRACES}
    cuts = {
        name: [0, *np.searchsorted(accumulate_times(one), edges_s).tolist(), len(one)]
        for name, one in records.items()
    }
    for number in range(len(edges_s) + 1):
        piece: dict[str, Any] = {
            name: one[slice(*cuts[name][number : number + 2])] for name, one in records.items()
        }
        yield replace(traces, **piece, bus=NO_BUS)
    none: dict[str, Any] = dict.fromkeys(records, NO_RECORDS)
    for bus in traces.bus.pieces():
        yield replace(traces, **none, bus=bus)


def accumulate_times(records: Records) -> FloatArray:
    """The times of records in s, made non-decreasing even if they are damaged."""
    times: FloatArray = np.fmax.accumulate(np.fmax(column(records, "t_s"), 0.0))
    return times


def read_bus(path: Path) -> BusLog:
    """A candump log; empty if it does not exist."""
    return StoredBus(path).whole() if path.exists() else NO_BUS


def read_scenario(run_dir: Path) -> dict[str, Any]:
    """The scenario as run, in raw tables."""
    path = run_dir / RunFile.SCENARIO
    if not path.exists():
        return {}
    document = parse_toml(path.read_text(encoding="utf-8"))
    if not document:
        raise DamagedFileError(f"{path} is damaged: it is empty")
    return document


def refuse_unreadable_lines(path: Path, bus: StoredBus) -> None:
    """Raise DamagedFileError if lines other than an incomplete last line are not in candump's format."""
    _ = bus.load  # reads all lines
    odd = bus.lines - bus.frames
    if odd > 0 or (bus.read_bytes > 0 and bus.frames == 0):
        raise DamagedFileError(
            f"{path} is damaged: {odd} of its {bus.lines} lines are no frames; others are read"
        )


Part = TypeVar("Part")


def part(damage: list[str], path: Path, read: Callable[[Path], Part], empty: Part) -> Part:
    """Read a file; if it is damaged, add a sentence to `damage` and return `empty`."""
    try:
        with reading(path, "the rest of the run is read without it"):
            return read(path)
    except DamagedFileError as error:
        damage.append(str(error))
        return empty


def read_run(run_dir: Path) -> RunTraces:
    """Read all records in `run_dir`, also of a run that was killed or is still running."""
    damage: list[str] = []

    def records(name: str) -> Records:
        return part(damage, run_dir / trace_file(name), read_trace, NO_RECORDS)

    def note(name: str) -> dict[str, Any]:
        nothing: dict[str, Any] = {}
        return part(damage, run_dir / name, read_json, nothing)

    can_log = run_dir / RunFile.CAN_LOG
    bus: Bus = NO_BUS
    if can_log.exists():
        bus = stored = StoredBus(can_log)
        part(damage, can_log, lambda path: refuse_unreadable_lines(path, stored), None)
    nothing: dict[str, Any] = {}
    found: dict[str, Any] = {name: records(name) for name in TRACES}
    return RunTraces(
        **found,
        others={name: records(name) for name in OTHER_TRACES},
        bus=bus,
        run=note(RunFile.NOTE),
        outcome=note(RunFile.OUTCOME),
        scenario=part(damage, run_dir / RunFile.SCENARIO, lambda path: read_scenario(path.parent), nothing),
        damage=damage,
    )
