"""Faults of processes and clocks: when a node's steps run, and the signals that real processes get.

If a clock jumps forwards, the loop skips the ticks in between once; if it jumps backwards, the loop sleeps
until its next deadline comes again. Jitter wakes the loop late. `Turns` calls a node's steps as a loop on the
faulty clock would: in lockstep, in the turns of a pacemaker, and in strict time.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_process import ClockFault, ProcessFault, Signal
from hil.timing.loop import UNTIMED, LoopTiming


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


SEED_OF_CLOCKS = 2000
"""Independent of the seeds of bus and sensor faults."""


class ClockFaults:
    """A scenario's faults of one process's clock. Times `t_s` are true times from the start."""

    def __init__(self, faults: Sequence[Fault], process: str, seed: int) -> None:
        own = [fault for fault in faults if isinstance(fault, ClockFault)]
        own = sorted((fault for fault in own if fault.faulty_process() == process), key=lambda one: one.at_s)
        self._jumps = [fault for fault in own if fault.ahead_s]
        self._jitters = [fault for fault in own if fault.latest_s]
        self._seed = [seed, SEED_OF_CLOCKS]
        self.restart()

    def restart(self) -> None:
        """Sample jitter anew, as a process that starts does."""
        self._noise = np.random.default_rng(self._seed)

    @property
    def any(self) -> bool:
        """Whether the clock has any fault."""
        return bool(self._jumps or self._jitters)

    def offset_s(self, t_s: float) -> float:
        """The time by which the clock is ahead."""
        acting = [jump for jump in self._jumps if jump.acts(t_s)]
        for jump in acting:
            jump.count()
        return math.fsum(jump.ahead_s for jump in acting)

    def true_s(self, own_s: float) -> float:
        """The true time at which the clock first shows `own_s` or more."""
        t_s = own_s
        for jump in self._jumps:
            if t_s >= jump.at_s:
                during_s = max(t_s - jump.ahead_s, jump.at_s)
                t_s = during_s if during_s < jump.end_s else max(t_s, jump.end_s)
        return t_s

    def lateness_s(self, t_s: float) -> float:
        """The delay of the next wake-up, sampled anew at each call."""
        acting = [jitter for jitter in self._jitters if jitter.acts(t_s)]
        for jitter in acting:
            jitter.count()
        largest_s = sum(jitter.latest_s for jitter in acting)
        return float(self._noise.uniform(0.0, largest_s)) if largest_s else 0.0


class Runner(Protocol):
    """The object that a loop calls in each tick."""

    def step(self, tick: int) -> None:
        """Run one tick."""

    def record(self, tick: int, timing: LoopTiming) -> None:
        """Append the tick's record."""

    def restart(self, tick: int) -> None:
        """Replace the node by a new one whose first tick is `tick`."""

    def close(self) -> None:
        """Close the traces."""


def restarts(fault: Fault, process: str) -> bool:
    """Whether a fault ends a process and starts it anew."""
    return isinstance(fault, ProcessFault) and fault.starts_anew and fault.process == process


class Turns:
    """Calls a runner once per slot of the bench when its clock or its process has a fault.

    Slot k lasts from the node's instant in tick k to the other node's next instant, half a period later. A
    step that is due after its slot runs in a later slot, before that slot's own step.
    """

    def __init__(
        self,
        runner: Runner,
        process: str,
        faults: Sequence[Fault],
        period_s: float,
        seed: int,
        first_slot: int = 0,
    ) -> None:
        """`first_slot`: above 0 for a process that replaces another, whose restart is over."""
        self._runner = runner
        self._clock = ClockFaults(faults, process, seed)
        self._starts_s = sorted(
            fault.end_s
            for fault in faults
            if restarts(fault, process) and fault.end_s > first_slot * period_s + TIME_RESOLUTION_S
        )
        self._period_s = period_s
        self._next_tick = 0
        self._last_slot = -1
        self._late_ticks: float | None = None
        self._unrecorded: int | None = None
        if first_slot > 0:
            self.resume(first_slot + round(self._clock.offset_s(first_slot * period_s) / period_s))
            self._last_slot = first_slot - 1

    def step(self, slot: int) -> None:
        """Run the steps that are due in this slot of the bench."""
        own_tick = self._own_tick(slot)
        if self.restarts_in(slot):
            del self._starts_s[0]
            self._runner.restart(own_tick)
            self._clock.restart()
            self._next_tick, self._late_ticks = own_tick, None
        for tick in self._ticks_until(slot, own_tick):
            if self._unrecorded is not None:
                self._runner.record(self._unrecorded, UNTIMED)
            self._runner.step(tick)
            self._unrecorded = tick

    def restarts_in(self, slot: int) -> bool:
        """Whether the runner is replaced in this slot."""
        return bool(self._starts_s) and slot * self._period_s >= self._starts_s[0] - TIME_RESOLUTION_S

    def ticks_in(self, slot: int) -> Iterator[int]:
        """The ticks of the steps that are due in this slot, for a caller that runs them itself."""
        return self._ticks_until(slot, self._own_tick(slot))

    def _own_tick(self, slot: int) -> int:
        """The tick that the runner's clock shows in this slot."""
        return slot + round(self._clock.offset_s(slot * self._period_s) / self._period_s)

    def _ticks_until(self, slot: int, own_tick: int) -> Iterator[int]:
        while True:
            if self._late_ticks is None:
                due_s = self._clock.true_s(self._next_tick * self._period_s)
                self._late_ticks = self._clock.lateness_s(due_s) / self._period_s
            woken_ticks = self._next_tick + self._late_ticks
            if woken_ticks >= own_tick + 0.5:
                return
            self._late_ticks = None
            # Ticks that passed during a clock jump or a pause of the process are skipped.
            woken_ticks = woken_ticks if woken_ticks >= own_tick - 0.5 else own_tick
            tick = self._next_tick + int(woken_ticks - self._next_tick)
            self._next_tick, self._last_slot = tick + 1, slot
            yield tick

    def is_in_step(self, slot: int) -> bool:
        """Whether the last step ran in the previous slot, and the next is due in this slot, without delay."""
        return self._last_slot == slot - 1 and self._next_tick == slot and not self._late_ticks

    def resume(self, tick: int) -> None:
        """Continue from `tick`, to which compiled code has advanced the node."""
        self._next_tick, self._late_ticks = tick, None
        self._last_slot = tick - 1

    def record(self, _: int, timing: LoopTiming) -> None:
        """Append the record of this slot's last step, if there was one."""
        if self._unrecorded is not None:
            self._runner.record(self._unrecorded, timing)
            self._unrecorded = None

    def close(self) -> None:
        """Close the traces."""
        self._runner.close()


def in_turns(
    runner: Runner,
    process: str,
    faults: Sequence[Fault],
    period_s: float,
    seed: int,
    first_slot: int = 0,
) -> Runner | Turns:
    """The object that is called in a runner's turns: itself if its process has no clock or restart fault."""
    if any(restarts(fault, process) for fault in faults) or ClockFaults(faults, process, seed).any:
        return Turns(runner, process, faults, period_s, seed, first_slot)
    return runner
