"""What a process can do to keep its deadlines, and what this machine lets it do."""

import ctypes
import gc
import os
import signal
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

# Linux's numbers; prctl(2), mlockall(2).
PR_SET_PDEATHSIG = 1
PR_SET_TIMERSLACK = 29
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4

HUB_PRIORITY = 30
"""Above the nodes: a frame that waits for its own sender is late for everyone."""
NODE_PRIORITY = 20
"""Both loops and the bare loop beside them, so that the three compare."""


class RealtimeReport(NamedTuple):
    """What was allowed."""

    fifo: bool
    """SCHED_FIFO: no ordinary process delays this one."""
    memory_locked: bool
    """No page that was once used is fetched again from disk."""
    timer_slack: bool
    """The kernel may not round wake-ups (50 µs by default)."""


@cache
def libc() -> ctypes.CDLL | None:
    """Linux's C library; None elsewhere."""
    return ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


@cache
def is_user_mode_linux() -> bool:
    """Whether the kernel is user-mode Linux, where SCHED_FIFO starves the kernel's own threads."""
    information = Path("/proc/cpuinfo")
    return information.exists() and "User Mode Linux" in information.read_text()


def become_realtime(priority: int) -> RealtimeReport:
    """Take what the machine allows: fixed priority, locked memory, exact timers, a quiet collector."""
    gc.collect()
    gc.freeze()
    library = libc()
    if library is None:
        return RealtimeReport(fifo=False, memory_locked=False, timer_slack=False)
    memory_locked = library.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0
    timer_slack = library.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return RealtimeReport(take_fifo(priority), memory_locked, timer_slack)


def take_fifo(priority: int) -> bool:
    """Ask for SCHED_FIFO; ordinary users mostly may not have it."""
    if is_user_mode_linux():
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def die_with_parent() -> None:
    """Have the kernel kill this process when the one that started it ends, however it ends."""
    library = libc()
    if library is not None:
        library.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
