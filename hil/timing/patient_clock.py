"""A clock for slow machines: the processes on a real bus wait for each other, so that none is late.

Each process writes its wake-up time into memory that all share, and continues once no other process has an
earlier wake-up time (the conservative order of Chandy and Misra, IEEE Trans. Softw. Eng. 5, 1979). The events
of a run therefore come in the order of their times, as in lockstep; a host stall only prolongs the run. No
process waits for one that is dead, stopped, or silent for `MOST_POLLS` polls; if it returns, it is late.

The bus must deliver at once, as vcan does: a frame arrives before its sender writes its next wake-up time.

The plant records its wake-ups on the wall clock; `RunTimes` uses them to convert the kernel's time stamps.
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
"""Folder of the shared memory; the temporary folder if it does not exist."""
POLL_S = 1e-4
POLLS_A_LOOK = 1_000
"""Polls (at least a tenth of a second) after which a waiting process checks whether the others still run."""
MOST_POLLS = 100_000
MOST_AHEAD_NS = 2_000_000
"""Largest lead of the others' wake-up times over a process they wait for: two ticks; beyond, it is late."""
MOST_BEHIND_NS = 1_000_000_000
"""Largest lag of the recorder: a quarter of the time that its socket can buffer."""
NEVER_NS = 1 << 62
NOTES = 1 << 17
"""Number of the plant's wake-ups that are kept: two minutes, more than the recorder's largest lag."""


class Row(IntEnum):
    """Each process's place in the shared memory."""

    OPERATOR = 0
    FIRMWARE = 1
    PLANT = 2
    FIRMWARE_AGAIN = 3
    PLANT_AGAIN = 4
    RECORDER = 5


UNTIL, PID, COUNT, RUN_NS, WALL_NS = 0, len(Row), 2 * len(Row), 2 * len(Row) + 1, 2 * len(Row) + 1 + NOTES
"""Offsets in words of eight bytes: each process's wake-up time, its process id; the plant's wake-ups."""
WORDS = WALL_NS + NOTES


def shared_memory() -> int:
    """Make the memory for one run and return its descriptor; it is freed when no process has it open."""
    with tempfile.TemporaryFile(dir=MEMORY if MEMORY.is_dir() else None) as file:
        file.truncate(8 * WORDS)
        descriptor = os.dup(file.fileno())
    words = words_of(descriptor)
    for row in (Row.FIRMWARE_AGAIN, Row.PLANT_AGAIN):
        words[UNTIL + row] = NEVER_NS
    return descriptor


def words_of(descriptor: int) -> memoryview:
    """The shared memory as 64-bit words."""
    return memoryview(mmap.mmap(descriptor, 8 * WORDS)).cast("q")


def has_stopped(pid: int) -> bool:
    """Whether a process is dead or was stopped by a signal; False where the system has no /proc."""
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
        """Processes not waited for: by offset, the wake-up time with which each was found missing."""
        self._now_ns = time.monotonic_ns()
        self._asked_ns: int | None = self._now_ns
        self._words[PID + row] = os.getpid()

    def now_ns(self) -> int:
        """Time of the run in ns: the last wake-up time plus the time since the first call after it."""
        asked_ns = time.monotonic_ns()
        self._asked_ns = self._asked_ns or asked_ns
        return self._now_ns + asked_ns - self._asked_ns

    def expect(self, row: Row, from_ns: int) -> None:
        """Also wait for the process `row` from the time `from_ns` on."""
        self._words[UNTIL + row] = from_ns

    def leave(self) -> None:
        """Declare that no process has to wait for this one any more."""
        self._words[UNTIL + self._row] = NEVER_NS

    def sleep_until(self, deadline_ns: int) -> None:
        """Return when no other process has a wake-up time before `deadline_ns`."""
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
        """Mark the processes that delay this one and have ended, stopped, or been silent for too long."""
        words = self._words
        for place in self._others:
            if words[place] < words[UNTIL + self._row] and (is_impatient or has_stopped(words[place + PID])):
                self._absent[place] = words[place]


class RunTimes:
    """The recorder's side: converts the kernel's time stamps, and delays the run if the recorder lags."""

    def __init__(self, descriptor: int, t0_ns: int) -> None:
        self._words: NDArray[np.int64] = np.frombuffer(words_of(descriptor), np.int64)
        self._t0_ns = t0_ns
        self._words[PID + Row.RECORDER] = os.getpid()
        self._words[UNTIL + Row.RECORDER] = t0_ns + MOST_BEHIND_NS

    def has_caught_up(self) -> None:
        """Let the run continue for another `MOST_BEHIND_NS`."""
        newest_ns = int(self._words[UNTIL + Row.PLANT])
        if newest_ns < NEVER_NS:
            self._words[UNTIL + Row.RECORDER] = newest_ns + MOST_BEHIND_NS

    def since_start_ns(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert wall-clock times to times of the run in ns, linear between two wake-ups of the plant.

        Times before the start of the run are negative.
        """
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
