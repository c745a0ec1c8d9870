"""Reads new records in a run folder while processes write to it."""

from pathlib import Path
from typing import Any

from hil.record.candump import BusLog, parse_candump
from hil.record.run_traces import RunTraces, read_trace
from hil.record.traces.stored_trace import Records
from hil.run_files import TRACES, RunFile, trace_file


class Follower:
    """Reads the new records of each trace and of can.log while a run continues."""

    def __init__(self, run_dir: Path) -> None:
        self.run_dir = run_dir
        self._read = dict.fromkeys(TRACES, 0)
        self._can_log_bytes = 0

    def new_traces(self, bus: BusLog) -> RunTraces:
        """The records of each trace since the last call, with these frames."""
        records: dict[str, Any] = {name: self._new_records(name) for name in TRACES}
        return RunTraces(**records, bus=bus)

    def _new_records(self, name: str) -> Records:
        """The new records of one trace; none while the trace does not exist."""
        records: Records = read_trace(self.run_dir / trace_file(name))[self._read[name] :]
        self._read[name] += len(records)
        return records

    def new_frames(self) -> BusLog:
        """The whole lines of can.log since the last call."""
        path = self.run_dir / RunFile.CAN_LOG
        text = b""
        if path.exists():
            with path.open("rb") as file:
                file.seek(self._can_log_bytes)
                text = file.read()
        whole = text[: text.rfind(b"\n") + 1]
        self._can_log_bytes += len(whole)
        return parse_candump(whole)
