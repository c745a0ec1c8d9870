"""Reads new records in a run folder while processes write to it."""

from pathlib import Path

from hil.record.candump import BusLog, parse_candump
from hil.record.run_traces import NO_RECORDS, RunTraces
from hil.record.traces import trace
from hil.record.traces.precision import TICKED, columns_of
from hil.record.traces.stored_trace import Columns, Records

TRACES = ("plant", "firmware", "impacts", "operator")


class Follower:
    """Reads the new records of each trace and of can.log while a run continues."""

    def __init__(self, run_dir: Path) -> None:
        self.run_dir = run_dir
        self._read = dict.fromkeys(TRACES, 0)
        self._can_log_bytes = 0

    def new_traces(self, bus: BusLog) -> RunTraces:
        """The records of each trace since the last call, with these frames."""
        plant, firmware, impacts, operator = map(self._new_records, TRACES)
        return RunTraces(plant, firmware, impacts, operator, bus)

    def _new_records(self, name: str) -> Records:
        """The new records of one trace; none while the trace does not exist."""
        path = self.run_dir / f"{name}.trace"
        if not path.exists():
            return NO_RECORDS
        records = trace.read(path, self._read[name])
        self._read[name] += len(records)
        return Columns(columns_of(records, name not in TICKED), len(records))

    def new_frames(self) -> BusLog:
        """The whole lines of can.log since the last call."""
        path = self.run_dir / "can.log"
        text = b""
        if path.exists():
            with path.open("rb") as file:
                file.seek(self._can_log_bytes)
                text = file.read()
        whole = text[: text.rfind(b"\n") + 1]
        self._can_log_bytes += len(whole)
        return parse_candump(whole)
