"""The trace of a controller that is not the bench's firmware: what it sends, and its own state.

Its state is recorded in each tick (`own.trace`). After the run this becomes `firmware.trace`, with columns
of the firmware's trace as far as frames on the bus give them; the others are NaN or 0. Figures, checks, log
and report are then those of any run. A controller that sends no heartbeat has no mode, and no tick counts.
"""

from pathlib import Path
from typing import Any, get_args

import numpy as np

from firmware_py.shell.builds import Build
from hil.record.bus_reconstruction import reconstruct_ticks
from hil.record.candump import StoredBus
from hil.record.run_traces import CAN_LOG, read_trace
from hil.record.traces.firmware_trace import fields_of
from hil.record.traces.trace import FieldType, TraceError, TraceWriter, flatten
from hil.timing.loop import LoopTiming
from plant_sim.text_input import TextInputError

NONE = "none"
"""In place of a build: no controller of the bench; another program on the bus is the controller."""
OWN = "own"
"""Prefix of the signals of a user's controller."""
OWN_TRACE = "own.trace"


def is_build(firmware: str) -> bool:
    """Whether `firmware` names a build of the bench's own firmware."""
    return firmware in get_args(Build)


def refuse_state(state: Any, firmware: str) -> None:
    """Raise TextInputError for a state that no trace can hold."""
    try:
        columns = flatten(OWN, type(state))
    except TraceError as error:
        raise TextInputError(
            f"--firmware {firmware}: {error}; make INITIAL a NamedTuple of float, int, bool or NamedTuples"
        ) from error
    if not isinstance(state, tuple) or not columns:
        raise TextInputError(f"--firmware {firmware}: INITIAL is no NamedTuple with at least one number")


class OwnTrace:
    """The state of a user's controller in each tick, with the interface of `FirmwareTrace`."""

    def __init__(self, out_dir: Path, state: FieldType, expected_records: int, resume: bool) -> None:
        fields = [("tick", int), ("t_s", float), (OWN, state), ("", LoopTiming)]
        self.writer = TraceWriter(out_dir / OWN_TRACE, fields, expected_records, resume)

    def append(self, node: Any, tick: int, t_s: float, timing: LoopTiming) -> None:
        """Record a tick of a node with a `state`."""
        self.writer.append(tick, t_s, node.state, timing)


def write_firmware_trace(run_dir: Path, period_s: float, walks: bool) -> None:
    """Write `firmware.trace` of a run whose controller was not the bench's firmware."""
    can_log, own_path = run_dir / CAN_LOG, run_dir / OWN_TRACE
    sent = reconstruct_ticks(StoredBus(can_log).whole(), period_s) if can_log.exists() else {}
    own = read_trace(own_path)[:] if own_path.exists() else np.zeros(0, [("tick", np.int64)])
    ticks = sent.get("tick", np.zeros(0, np.int64))
    names = [name for name in own.dtype.names or () if name.startswith(f"{OWN}.")]
    kinds = [(name, float) for name in names]
    with TraceWriter(run_dir / "firmware.trace", [*fields_of(walks), *kinds]) as writer:
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
