"""Process faults: the schedule of the processes, and the signals in real time."""

import math
import signal
from collections.abc import Sequence
from typing import NamedTuple

from hil.scenario.fault_tables import Fault, Killed, Paused, ProcessFault, Restarted

PLANT, FIRMWARE = "plant", "firmware"


class Signal(NamedTuple):
    """A signal sent to a process."""

    at_s: float
    process: str
    number: signal.Signals


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
        return not self._faults or not any(
            fault.process == process
            and (t_s >= fault.at_s - 1e-9 if isinstance(fault, Killed) else fault.acts(t_s))
            for fault in self._faults
        )

    def kills(self, process: str, by_s: float = math.inf) -> bool:
        """Whether the scenario itself kills `process` at or before `by_s`."""
        return any(
            isinstance(fault, Killed | Restarted) and fault.process == process and fault.at_s <= by_s
            for fault in self._faults
        )

    def signals(self) -> list[Signal]:
        """The signals that produce these faults in real processes, in order of time."""
        signals = []
        for fault in self._faults:
            match fault:
                case Killed(process=process, at_s=at_s) | Restarted(process=process, at_s=at_s):
                    signals.append(Signal(at_s, process, signal.SIGKILL))
                case Paused(process=process, at_s=at_s, end_s=end_s):
                    signals.append(Signal(at_s, process, signal.SIGSTOP))
                    signals.append(Signal(end_s, process, signal.SIGCONT))
        return sorted(signals)

    def paused_at(self, t_s: float) -> list[str]:
        """The processes that are paused at `t_s`."""
        return [
            fault.process for fault in self._faults if isinstance(fault, Paused) and fault.acts(t_s - 1e-9)
        ]

    def restarts(self) -> list[Restart]:
        """The restarts of processes, in order of time."""
        return sorted(
            Restart(fault.at_s, fault.process, fault.end_s)
            for fault in self._faults
            if isinstance(fault, Restarted)
        )
