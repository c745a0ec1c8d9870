"""A run folder read back: the traces that figures, log and report are made of, and nothing else."""

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hil import trace
from hil.damage import DamagedFileError, reading

Records = NDArray[np.void]
"""A structured array, one record a tick (or an impact), columns by the names of the trace."""

FloatArray = NDArray[np.float64]

CANDUMP_LINE = re.compile(rb"\((\d{1,12}\.\d{6,9})\) \S+ ([0-9A-Fa-f]{1,8})#((?:[0-9A-Fa-f]{2}){0,64})\r?\n")


LOSSES = "losses.json"
"""What the recorder lost, beside can.log; no file where it lost nothing."""


@dataclass(frozen=True, slots=True)
class LogLoss:
    """Frames that were on the bus and are not in can.log, and the simulated time around them."""

    from_s: float
    to_s: float
    frames: int


@dataclass(frozen=True)
class BusLog:
    """The frames of `can.log`: simulated seconds, identifiers, lengths in bytes; shapes (n,)."""

    t_s: FloatArray
    can_id: NDArray[np.int64]
    length: NDArray[np.int64]
    payloads: tuple[bytes, ...]


@dataclass(frozen=True)
class RunTraces:
    """All a run left behind. A trace whose process never wrote is an empty array without columns."""

    plant: Records
    firmware: Records
    impacts: Records
    operator: Records
    bus: BusLog
    run: Mapping[str, Any] = field(default_factory=dict)
    outcome: Mapping[str, Any] = field(default_factory=dict)
    scenario: Mapping[str, Any] = field(default_factory=dict)
    losses: Sequence[LogLoss] = ()
    damage: Sequence[str] = ()
    """What of it cannot be read, a sentence a file."""

    @property
    def is_worn(self) -> bool:
        """Whether somebody wears the module."""
        return "wearer" in self.scenario.get("scene", {})

    @property
    def is_walked(self) -> bool:
        """Whether somebody walks with it."""
        return "gait" in self.scenario.get("scene", {})


NO_RECORDS: Records = np.zeros(0, dtype=[])

NO_BUS = BusLog(
    t_s=np.zeros(0),
    can_id=np.zeros(0, np.int64),
    length=np.zeros(0, np.int64),
    payloads=(),
)

NOTHING_LEFT = RunTraces(NO_RECORDS, NO_RECORDS, NO_RECORDS, NO_RECORDS, NO_BUS)
"""Of a run that left nothing behind."""


def column(records: Records, name: str) -> FloatArray:
    """One column as floats; an empty trace gives an empty column, an unknown name raises."""
    names = records.dtype.names or ()
    if name in names:
        return np.asarray(records[name], dtype=np.float64)
    if len(records) == 0:
        return np.zeros(0)
    near = ", ".join(difflib.get_close_matches(name, names, n=3)) or ", ".join(names)
    raise KeyError(f"the trace has no column {name!r}; it has {near}")


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object, or an empty one where the file is not there."""
    if not path.exists():
        return {}
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise DamagedFileError(f"{path} is damaged: it holds no JSON object")
    return content


def read_trace(path: Path) -> Records:
    """A trace, or an empty one where its process never got to write it."""
    return trace.read(path) if path.exists() else NO_RECORDS


def parse_candump(text: bytes) -> BusLog:
    """candump's log lines, `(seconds.micros) channel ID#DATA`; a line cut short by a kill is left out.

    >>> log = parse_candump(b"(10.001000) vcan0 080#0102\\n(10.002000) vcan0 0")
    >>> log.t_s.tolist(), hex(log.can_id[0]), log.payloads
    ([10.001], '0x80', (b'\\x01\\x02',))
    """
    t_s, can_id, payloads = [], [], []
    for match in CANDUMP_LINE.finditer(text):
        seconds, identifier, data = match.groups()
        t_s.append(float(seconds))
        can_id.append(int(identifier, 16))
        payloads.append(bytes.fromhex(data.decode()))
    return BusLog(
        t_s=np.array(t_s, np.float64),
        can_id=np.array(can_id, np.int64),
        length=np.array([len(payload) for payload in payloads], np.int64),
        payloads=tuple(payloads),
    )


def read_bus(path: Path) -> BusLog:
    """`can.log`, or an empty log where nobody wrote it."""
    return parse_candump(path.read_bytes()) if path.exists() else NO_BUS


def read_scenario(run_dir: Path) -> dict[str, Any]:
    """The scenario as run, in raw tables."""
    path = run_dir / "scenario.toml"
    if not path.exists():
        return {}
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    if not document:
        raise DamagedFileError(f"{path} is damaged: it is empty")
    return document


def note_unreadable_lines(path: Path, bus: BusLog) -> None:
    """Raise DamagedFileError where more than a last line that was cut is not of candump's format."""
    content = path.read_bytes() if path.exists() else b""
    lines = content.count(b"\n")
    odd = lines - len(bus.t_s)
    if odd > 0 or (len(content) > 0 and len(bus.t_s) == 0):
        raise DamagedFileError(
            f"{path} is damaged: {odd} of its {lines} lines are no frames; others are read"
        )


Part = TypeVar("Part")


def part(damage: list[str], path: Path, read: Callable[[Path], Part], empty: Part) -> Part:
    """What `read` makes of a file; where it is damaged that is noted, and it counts as `empty`."""
    try:
        with reading(path, "the rest of the run is read without it"):
            return read(path)
    except DamagedFileError as error:
        damage.append(str(error))
        return empty


def read_run(run_dir: Path) -> RunTraces:
    """Everything in `run_dir`, also of a run that was killed or is still going."""
    damage: list[str] = []

    def records(name: str) -> Records:
        return part(damage, run_dir / f"{name}.trace", read_trace, NO_RECORDS)

    def note(name: str) -> dict[str, Any]:
        nothing: dict[str, Any] = {}
        return part(damage, run_dir / name, read_json, nothing)

    can_log = run_dir / "can.log"
    bus = part(damage, can_log, read_bus, NO_BUS)
    part(damage, can_log, lambda path: note_unreadable_lines(path, bus), None)
    nothing: dict[str, Any] = {}
    no_losses: list[LogLoss] = []
    return RunTraces(
        plant=records("plant"),
        firmware=records("firmware"),
        impacts=records("impacts"),
        operator=records("operator"),
        bus=bus,
        run=note("run.json"),
        outcome=note("outcome.json"),
        scenario=part(damage, run_dir / "scenario.toml", lambda path: read_scenario(path.parent), nothing),
        losses=part(damage, run_dir / LOSSES, read_losses, no_losses),
        damage=damage,
    )


def read_losses(path: Path) -> list[LogLoss]:
    """What the recorder could not log."""
    return [LogLoss(**loss) for loss in read_json(path).get("losses", [])]
