"""The trace of a controller that is not the bench's firmware: what it sends, and its own state.

Its state is recorded in each tick (`own.trace`). After the run this becomes `firmware.trace`, with columns
of the firmware's trace as far as frames on the bus give them; the others are NaN or 0. Figures, checks, log
and report are then those of any run. A controller that sends no heartbeat has no mode, and no tick counts.
"""

from typing import Any

from hil.record.traces.trace import Fields, FieldType, OpenTrace, RecordWriter, TraceError, flatten
from hil.run_files import OWN
from hil.timing.loop import LoopTiming
from text_input import TextInputError

NONE = "none"
"""In place of a build: no controller of the bench; another program on the bus is the controller."""


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


def own_fields(state: FieldType) -> Fields:
    """The columns of a record of a user's controller with this state."""
    return [("tick", int), ("t_s", float), (OWN, state), ("", LoopTiming)]


class OwnTrace:
    """The state of a user's controller in each tick, with the interface of `FirmwareTrace`."""

    def __init__(self, writer: RecordWriter) -> None:
        """`writer`: of records of `own_fields`."""
        self.writer = writer

    def append(self, node: Any, tick: int, t_s: float, timing: LoopTiming) -> None:
        """Record a tick of a node with a `state`."""
        self.writer.append(tick, t_s, node.state, timing)


def open_own_trace(state: FieldType, traces: OpenTrace, _: bool) -> OwnTrace | None:
    """The trace of a controller with this state; None if it is not kept."""
    writer = traces(OWN, own_fields(state), is_ticked=True)
    return None if writer is None else OwnTrace(writer)
