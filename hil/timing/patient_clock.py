"""A clock for slow machines: processes on a real bus wait for each other, so that none is late.

Each process says until when it sleeps, in memory that all share, and goes on once nobody else has anything to
do before then (the conservative order of Chandy and Misra, IEEE Trans. Softw. Eng. 5, 1979). So the events of
a run come in the order of their times, as in lockstep; a pause of the machine only makes it take longer. A
process that is dead, stopped, or silent for `MOST_POLLS` polls holds up nobody; back again, it is late.

The bus has to deliver at once, as vcan does: a frame is there before its sender says that it sleeps.

The plant notes when it woke by the wall clock, by which `RunTimes` dates what the kernel has stamped.
"""

import mmap
import os
import tempfile
import time
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MEMORY = Path("/dev/shm")
"""Where the shared memory lies, where there is such a place."""
POLL_S = 1e-4
POLLS_A_LOOK = 1_000
"""After these in vain, a tenth of a second at least, the others are looked at."""
MOST_POLLS = 100_000
MOST_AHEAD_NS = 2_000_000
"""The others sleep no longer than this beyond a process that they have waited for: two ticks."""
MOST_BEHIND_NS = 1_000_000_000
"""The recorder's largest lag: a quarter of what its socket holds."""
NEVER_NS = 1 << 62
NOTES = 1 << 17
"""Wake-ups of the plant that are kept: two minutes, more than a recorder is ever behind."""


class Row(IntEnum):
    """Each process's place in the shared memory."""

    OPERATOR = 0
    FIRMWARE = 1
    PLANT = 2
    FIRMWARE_AGAIN = 3
    PLANT_AGAIN = 4
    RECORDER = 5


UNTIL, PID, COUNT, RUN_NS, WALL_NS = 0, len(Row), 2 * len(Row), 2 * len(Row) + 1, 2 * len(Row) + 1 + NOTES
"""Where in it, in words of eight bytes: until when each sleeps, who it is; the plant's notes."""
WORDS = WALL_NS + NOTES


def shared_memory() -> int:
    """Make memory for one run; gives its descriptor. Nothing of it stays once nobody has it open."""
    with tempfile.TemporaryFile(dir=MEMORY if MEMORY.is_dir() else None) as file:
        file.truncate(8 * WORDS)
        descriptor = os.dup(file.fileno())
    words = words_of(descriptor)
    for row in (Row.FIRMWARE_AGAIN, Row.PLANT_AGAIN):
        words[UNTIL + row] = NEVER_NS
    return descriptor


def words_of(descriptor: int) -> memoryview:
    """The shared memory."""
    return memoryview(mmap.mmap(descriptor, 8 * WORDS)).cast("q")


def has_stopped(pid: int) -> bool:
    """Whether a process is dead or was stopped by a signal, as far as the system says."""
    if not Path("/proc/self/stat").exists() or pid == 0:
        return False
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    return state in "ZXTt"


class PatientClock:
    """The clock of one process of a run."""

    def __init__(self, descriptor: int, row: Row) -> None:
        self._words = words_of(descriptor)
        self._row = row
        self._others = [UNTIL + other for other in Row if other != row]
        self._absent: dict[int, int] = {}
        """Who is not waited for: by place, the time at which it was found missing."""
        self._now_ns = time.monotonic_ns()
        self._asked_ns: int | None = self._now_ns
        self._words[PID + row] = os.getpid()

    def now_ns(self) -> int:
        """The run's time: that of the last wake-up, and what has passed since it was first asked for then."""
        asked_ns = time.monotonic_ns()
        self._asked_ns = self._asked_ns or asked_ns
        return self._now_ns + asked_ns - self._asked_ns

    def expect(self, row: Row, from_ns: int) -> None:
        """Wait for another process, too, once `from_ns` has come."""
        self._words[UNTIL + row] = from_ns

    def leave(self) -> None:
        """Nobody waits for this process any more."""
        self._words[UNTIL + self._row] = NEVER_NS

    def sleep_until(self, deadline_ns: int) -> None:
        """Return when nobody else has anything to do before `deadline_ns`."""
        words = self._words
        words[UNTIL + self._row] = deadline_ns
        polls = 0
        while (others_ns := self._earliest()) < deadline_ns:
            time.sleep(POLL_S)
            polls += 1
            if polls % POLLS_A_LOOK == 0:
                self._look(polls > MOST_POLLS)
        is_late = others_ns - deadline_ns > MOST_AHEAD_NS and others_ns < NEVER_NS
        self._now_ns, self._asked_ns = others_ns if is_late else deadline_ns, None
        if self._row in (Row.PLANT, Row.PLANT_AGAIN):
            place = words[COUNT] % NOTES
            words[RUN_NS + place], words[WALL_NS + place] = deadline_ns, time.time_ns()
            words[COUNT] += 1

    def _earliest(self) -> int:
        """The earliest wake-up time of the other processes."""
        words, absent = self._words, self._absent
        present = (words[place] for place in self._others if absent.get(place) != words[place])
        return min(present, default=NEVER_NS)

    def _look(self, is_impatient: bool) -> None:
        """Note who holds up this process and is gone, or has been silent for too long."""
        words = self._words
        for place in self._others:
            if words[place] < words[UNTIL + self._row] and (is_impatient or has_stopped(words[place + PID])):
                self._absent[place] = words[place]


class RunTimes:
    """The recorder's side: dates what the kernel has stamped, and holds up the run where it falls behind."""

    def __init__(self, descriptor: int, t0_ns: int) -> None:
        self._words: NDArray[np.int64] = np.frombuffer(words_of(descriptor), np.int64)
        self._t0_ns = t0_ns
        self._words[PID + Row.RECORDER] = os.getpid()
        self._words[UNTIL + Row.RECORDER] = t0_ns + MOST_BEHIND_NS

    def has_caught_up(self) -> None:
        """The run may go on for another `MOST_BEHIND_NS`."""
        newest_ns = int(self._words[UNTIL + Row.PLANT])
        if newest_ns < NEVER_NS:
            self._words[UNTIL + Row.RECORDER] = newest_ns + MOST_BEHIND_NS

    def since_start_ns(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of the run, before its start negative; between two wake-ups of the plant they pass evenly."""
        words = self._words
        count = int(words[COUNT])
        if count == 0:
            return np.full(wall_ns.shape, -1, np.int64)
        places = np.arange(max(0, count - NOTES), count) % NOTES
        run_ns, woken_ns = words[RUN_NS + places], words[WALL_NS + places]
        first_ns, last_ns = woken_ns[0], run_ns[-1]
        until_ns = min(words[UNTIL + Row.PLANT], last_ns + MOST_AHEAD_NS)
        run_ns = np.append(run_ns, until_ns) - self._t0_ns
        woken_ns = np.maximum.accumulate(np.append(woken_ns, wall_ns.max(initial=0))) - first_ns
        times_ns = np.interp(wall_ns - first_ns, woken_ns, run_ns)
        return np.where(wall_ns < first_ns, -1, times_ns).astype(np.int64)
