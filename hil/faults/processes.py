"""Process faults: the schedule of the processes, and the signals in real time."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_process import ProcessFault, Signal


class Restart(NamedTuple):
    """A process killed at `at_s` and replaced by a new process that starts at `start_s`."""

    at_s: float
    process: str
    start_s: float


class ProcessFaults:
    """A scenario's process faults."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, ProcessFault)]

    def runs(self, process: str, t_s: float) -> bool:
        """Whether `process` runs at `t_s`; a killed process does not run again."""
        return not self._acting(process, t_s)

    def _acting(self, process: str, t_s: float) -> list[ProcessFault]:
        return [fault for fault in self._faults if fault.process == process and fault.acts(t_s)]

    def takes_turn(self, process: str, t_s: float) -> bool:
        """As `runs`, for a turn of the process at `t_s`; a turn that it misses is counted."""
        acting = self._acting(process, t_s)
        for fault in acting:
            fault.count()
        return not acting

    def absences(self, process: str, period_s: float, ticks: int) -> list[tuple[int, int]]:
        """The intervals [from, to) of ticks in which `process` does not run."""
        edges_s = [
            edge for fault in self._faults for edge in (fault.at_s, min(fault.end_s, ticks * period_s))
        ]
        near = {int(edge_s / period_s) + beside for edge_s in edges_s for beside in (-1, 0, 1, 2)}
        edges = [*sorted(edge for edge in near if 0 <= edge < ticks), ticks]
        return [(begin, end) for begin, end in pairwise(edges) if not self.runs(process, begin * period_s)]

    def kills(self, process: str, by_s: float = math.inf) -> bool:
        """Whether the scenario itself kills `process` at or before `by_s`."""
        return any(
            fault.ends_process and fault.process == process and fault.at_s <= by_s for fault in self._faults
        )

    def signals(self) -> list[Signal]:
        """The signals that produce these faults in real processes, in order of time."""
        return sorted(one for fault in self._faults for one in fault.signals())

    def paused_at(self, t_s: float) -> list[str]:
        """The processes that are paused at `t_s`."""
        return [
            fault.process
            for fault in self._faults
            if not fault.ends_process and fault.acts(t_s - TIME_RESOLUTION_S)
        ]

    def restarts(self) -> list[Restart]:
        """The restarts of processes, in order of time."""
        return sorted(
            Restart(fault.at_s, fault.process, fault.end_s) for fault in self._faults if fault.starts_anew
        )
