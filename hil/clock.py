"""The clock that only loops read: monotonic, integer nanoseconds, absolute deadlines.

The clock of a slow run goes at a quarter of the wall clock's speed, for machines that could not keep up with
that. All times of a run are its own clock's.
"""

import ctypes
import time
from collections.abc import Mapping
from typing import Final, Literal, Protocol

from hil.realtime import libc

TIMER_ABSTIME = 1
NS_PER_S = 1_000_000_000

ClockName = Literal["real", "slow", "lockstep"]
SPEEDS: Final[Mapping[str, float]] = {"real": 1.0, "slow": 0.25}
"""How many seconds of a run with processes pass in one of the wall clock."""


class Clock(Protocol):
    """What a loop needs of time; a test's clock has the same two methods."""

    def now_ns(self) -> int:
        """The time."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns` or soon after, or at once if it has passed."""


class Timespec(ctypes.Structure):
    """`struct timespec` of a 64-bit machine."""

    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class MonotonicClock:
    """The machine's monotonic clock, the same for all its processes; it goes at `speed`.

    Where the kernel sleeps until an absolute time, that is one system call and no reading of the clock.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        library = libc()
        self._nanosleep = None if library is None else library.clock_nanosleep
        self._deadline = Timespec()
        self._deadline_pointer = ctypes.byref(self._deadline)

    def now_ns(self) -> int:
        """The time."""
        return int(time.monotonic_ns() * self._speed)

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute time; a signal's handler runs at once, then the sleep goes on."""
        if self._nanosleep is None:
            while (rest_ns := deadline_ns - self.now_ns()) > 0:
                time.sleep(rest_ns / (NS_PER_S * self._speed))
            return
        self._deadline.seconds, self._deadline.nanoseconds = divmod(
            round(deadline_ns / self._speed), NS_PER_S
        )
        while self._nanosleep(time.CLOCK_MONOTONIC, TIMER_ABSTIME, self._deadline_pointer, None) != 0:
            pass
