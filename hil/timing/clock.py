"""The clock that only loops read: monotonic, integer nanoseconds, absolute deadlines."""

import ctypes
import time
from typing import Literal, Protocol

from hil.timing.realtime import libc

TIMER_ABSTIME = 1
NS_PER_S = 1_000_000_000

ClockName = Literal["real", "lockstep"]
"""Processes on the wall clock; all nodes in one process, as fast as possible."""

TimeName = Literal["held", "strict"]
"""Real time that is held while a process is late (`hil.timing.pacemaker`), or that goes on without it."""


class Clock(Protocol):
    """Interface of a loop's clock; tests implement the same two methods."""

    def now_ns(self) -> int:
        """The time in ns."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns` or soon after, or at once if it has passed."""


class Timespec(ctypes.Structure):
    """`struct timespec` of a 64-bit machine."""

    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class MonotonicClock:
    """The machine's monotonic clock, the same for all its processes.

    Where the kernel can sleep until an absolute time, a sleep is one system call without a clock reading.
    """

    def __init__(self) -> None:
        library = libc()
        self._nanosleep = None if library is None else library.clock_nanosleep
        self._deadline = Timespec()
        self._deadline_pointer = ctypes.byref(self._deadline)

    def now_ns(self) -> int:
        """The time in ns."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute time; a signal's handler runs at once, then the sleep continues."""
        if self._nanosleep is None:
            while (rest_ns := deadline_ns - self.now_ns()) > 0:
                time.sleep(rest_ns / NS_PER_S)
            return
        self._deadline.seconds, self._deadline.nanoseconds = divmod(deadline_ns, NS_PER_S)
        while self._nanosleep(time.CLOCK_MONOTONIC, TIMER_ABSTIME, self._deadline_pointer, None) != 0:
            pass
