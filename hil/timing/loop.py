"""The loops of a node: at absolute deadlines, or in turns that a pacemaker gives.

At absolute deadlines, in strict time, overruns are skipped and counted, never caught up in a burst.
"""

from collections.abc import Callable
from time import monotonic_ns, thread_time_ns
from typing import NamedTuple, Protocol

from hil.timing.clock import Clock
from hil.timing.pacemaker import Turn


class LoopTiming(NamedTuple):
    """Timing of one tick, for the trace.

    `work_us` runs from waking up to the last frame sent; writing the trace's record, some microseconds,
    comes after it.
    """

    deadline_ns: int
    wake_latency_us: float
    work_us: float
    overruns: int
    """Ticks skipped since the start because the next tick's deadline had already passed."""
    cpu_us: float = 0.0
    """CPU time since the end of the previous tick's work: what the node itself, not the host, has taken."""


UNTIMED = LoopTiming(0, 0.0, 0.0, 0)
"""Timing of a tick that is not measured."""


class FixedRateLoop:
    """Calls a step at t0 + offset + k · period.

    A step receives its tick k, and returns the tick of the next one. After it, `record` receives the tick and
    its timing. Three clock readings and one sleep a tick, without `record` one reading.
    """

    def __init__(self, clock: Clock, t0_ns: int, period_ns: int, offset_ns: int = 0) -> None:
        self.clock = clock
        self.period_ns = period_ns
        self.first_deadline_ns = t0_ns + offset_ns
        self.overruns = 0
        self.stopping = False

    def stop(self) -> None:
        """End the loop after the tick it is in, or before the one it waits for; safe in a signal handler."""
        self.stopping = True

    def run(
        self,
        ticks: int | None,
        step: Callable[[int], int],
        record: Callable[[int, LoopTiming], None] | None,
        first_tick: int = 0,
    ) -> None:
        """Run ticks `first_tick` … ticks − 1, or until `stop`; without `record` the work is not timed."""
        clock, period_ns = self.clock, self.period_ns
        tick = first_tick
        last_cpu_ns = thread_time_ns()
        while not self.stopping and (ticks is None or tick < ticks):
            deadline_ns = self.first_deadline_ns + tick * period_ns
            clock.sleep_until(deadline_ns)
            if self.stopping:
                return
            woken_ns = clock.now_ns()
            if woken_ns - deadline_ns >= period_ns:
                skipped = (woken_ns - deadline_ns) // period_ns
                if ticks is not None:
                    skipped = min(skipped, ticks - 1 - tick)
                self.overruns += skipped
                tick += skipped
                deadline_ns += skipped * period_ns
            next_tick = step(tick)
            if record is not None:
                done_ns, cpu_ns = clock.now_ns(), thread_time_ns()
                late_us, work_us = (woken_ns - deadline_ns) * 1e-3, (done_ns - woken_ns) * 1e-3
                cpu_us, last_cpu_ns = (cpu_ns - last_cpu_ns) * 1e-3, cpu_ns
                record(tick, LoopTiming(deadline_ns, late_us, work_us, self.overruns, cpu_us))
            tick = next_tick


class TurnGiver(Protocol):
    """The pacemaker as a node sees it."""

    def await_turn(self) -> Turn | None:
        """Wait for the node's turn; None if there is none any more."""

    def end_turn(self, cpu_ns: int, next_tick: int) -> None:
        """End the turn, in which the node used the CPU for `cpu_ns`; it needs none before `next_tick`."""


def run_turns(
    giver: TurnGiver, step: Callable[[int], int], record: Callable[[int, LoopTiming], None]
) -> None:
    """Call `step` in each turn with its tick, and after the turn `record`, until there are no more turns.

    `step` returns the tick of the node's next turn.
    """
    last_cpu_ns = thread_time_ns()
    while (turn := giver.await_turn()) is not None:
        woken_ns = monotonic_ns()
        next_tick = step(turn.tick)
        cpu_ns = thread_time_ns()
        used_ns, last_cpu_ns = cpu_ns - last_cpu_ns, cpu_ns
        giver.end_turn(used_ns, next_tick)
        done_ns = monotonic_ns()
        late_us, work_us = (woken_ns - turn.due_ns) * 1e-3, (done_ns - woken_ns) * 1e-3
        record(turn.tick, LoopTiming(turn.due_ns, late_us, work_us, 0, used_ns * 1e-3))
