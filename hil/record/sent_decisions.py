"""The trace of a controller that is not the bench's firmware, made of what it sent and of its own state."""

from pathlib import Path

import numpy as np

from hil.record.bus_reconstruction import reconstruct_ticks
from hil.record.candump import StoredBus
from hil.record.run_traces import read_trace
from hil.record.traces.firmware_trace import fields_of
from hil.record.traces.trace import TraceWriter
from hil.run_files import OWN, RunFile, trace_file
from hil.timing.loop import LoopTiming


def write_firmware_trace(run_dir: Path, period_s: float, walks: bool) -> None:
    """Write `firmware.trace` of a run whose controller was not the bench's firmware."""
    can_log, own_path = run_dir / RunFile.CAN_LOG, run_dir / trace_file(OWN)
    sent = reconstruct_ticks(StoredBus(can_log).whole(), period_s) if can_log.exists() else {}
    own = read_trace(own_path)[:] if own_path.exists() else np.zeros(0, [("tick", np.int64)])
    ticks = sent.get("tick", np.zeros(0, np.int64))
    names = [name for name in own.dtype.names or () if name.startswith(f"{OWN}.")]
    kinds = [(name, float) for name in names]
    with TraceWriter(run_dir / trace_file("firmware"), [*fields_of(walks), *kinds]) as writer:
        records = np.zeros(len(ticks), writer.dtype)
        columns = writer.dtype.names or ()
        for name in columns:
            if writer.dtype[name].kind == "f":
                records[name] = np.nan
        for name, values in sent.items():
            if name in columns:
                records[name] = values
        _, of_sent, of_own = np.intersect1d(ticks, own["tick"], return_indices=True)
        for name in (*names, *(one for one in LoopTiming._fields if one in (own.dtype.names or ()))):
            records[name][of_sent] = own[name][of_own]
        writer.append_all(records)
