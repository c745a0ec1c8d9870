"""The clock that only loops read: monotonic, integer nanoseconds, absolute deadlines."""

import ctypes
import errno
import time
from typing import Literal, Protocol

from hil.timing.realtime import libc

NS_PER_S = 1_000_000_000
NS_PER_US = 1000
TICK_S = 1e-3
"""Length of a tick: the highest rate that classic CAN at 1 Mbit/s can carry. Lockstep may use another."""
OPERATOR_PERIOD_S = 0.01
"""Longest time between two steps of an operator that is recorded, or that waits for an answer."""

ClockName = Literal["real", "lockstep"]
"""Processes on the wall clock; all nodes in one process, as fast as possible."""

IMPORTED = "imported"
"""Clock name of a log imported from a real bench, which has no truth and no scenario."""

TIMER_ABSTIME = 1
"""Linux's flag of a sleep until a time; clock_nanosleep(2)."""

TimeName = Literal["held", "strict"]
"""Real time that is held while a process is late (`hil.timing.pacemaker`), or that goes on without it."""


class Clock(Protocol):
    """Interface of a loop's clock; tests implement the same two methods."""

    def now_ns(self) -> int:
        """The time in ns."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns` or soon after, or at once if it has passed."""


class MonotonicClock:
    """The machine's monotonic clock, the same for all its processes.

    On Linux a sleep is one system call, and Python's takes three: under user-mode Linux each costs 15 µs.
    """

    def __init__(self) -> None:
        library = libc()
        self._sleep = None if library is None else library.clock_nanosleep
        self._until = (ctypes.c_long * 2)()

    def now_ns(self) -> int:
        """The time in ns."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute time; a signal's handler runs at once, then the sleep continues."""
        if self._sleep is not None:
            self._until[0], self._until[1] = divmod(deadline_ns, NS_PER_S)
            while self._sleep(time.CLOCK_MONOTONIC, TIMER_ABSTIME, self._until, None) == errno.EINTR:
                pass
            return
        while (rest_ns := deadline_ns - time.monotonic_ns()) > 0:
            time.sleep(rest_ns / NS_PER_S)
