"""The fixed-rate loop: absolute deadlines, overruns skipped and counted, never caught up in a burst."""

from collections.abc import Callable
from typing import NamedTuple

from hil.timing.clock import Clock


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


class FixedRateLoop:
    """Calls a step at t0 + offset + k · period.

    A step receives its tick k and how many periods have passed since the step before. After it, `record`
    receives the tick and its timing. Two clock readings and one sleep a tick.
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
        step: Callable[[int, int], None],
        record: Callable[[int, LoopTiming], None] | None,
        first_tick: int = 0,
    ) -> None:
        """Run ticks `first_tick` … ticks − 1, or until `stop`; without `record` the work is not timed."""
        clock, period_ns = self.clock, self.period_ns
        tick, last_tick = first_tick, first_tick - 1
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
            step(tick, tick - last_tick)
            if record is not None:
                done_ns = clock.now_ns()
                late_us, work_us = (woken_ns - deadline_ns) * 1e-3, (done_ns - woken_ns) * 1e-3
                record(tick, LoopTiming(deadline_ns, late_us, work_us, self.overruns))
            last_tick = tick
            tick += 1
