"""Real-time priority and locked memory for a process, as far as the machine permits."""

import atexit
import ctypes
import gc
import os
import platform
import re
import resource
import signal
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import NamedTuple

# Constants of Linux; prctl(2), mlockall(2), sched_setattr(2).
PR_SET_PDEATHSIG = 1
PR_SET_TIMERSLACK = 29
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
CAP_IPC_LOCK = 14

SCHED_SETATTR = {"x86_64": 314, "aarch64": 274, "riscv64": 274}
"""Number of the system call by machine; C libraries have no function for it."""
SCHED_DEADLINE = 6
RESET_ON_FORK = 1
SCHEDULING_ATTRIBUTES = struct.Struct("=IIQiIQQQII")

NODE_PRIORITY = 20
OPERATOR_PRIORITY = NODE_PRIORITY
"""The operator's work is short; at a lower priority the nodes could block it on a slow machine."""
BRIDGE_PRIORITY = NODE_PRIORITY - 1
"""All frames of an adapter pass through the bridge. An adapter's library that polls gets only the time that
the nodes leave."""


class Reservation(NamedTuple):
    """A process's share of a CPU: `runtime_ns` in each `period_ns`, or a fixed `priority`."""

    runtime_ns: int
    period_ns: int
    priority: int


NODE = Reservation(runtime_ns=600_000, period_ns=1_000_000, priority=NODE_PRIORITY)
"""A loop at 1 kHz: twice the firmware's run time on a busy machine."""
RECORDING_OPERATOR = Reservation(runtime_ns=3_000_000, period_ns=10_000_000, priority=NODE_PRIORITY - 1)
"""An operator that records all frames of ten periods at once, which would delay nodes of its priority."""
BASELINE = Reservation(runtime_ns=100_000, period_ns=1_000_000, priority=NODE_PRIORITY)
"""The bare loop, scheduled like the two nodes so that the three can be compared."""
HUB = Reservation(runtime_ns=100_000, period_ns=250_000, priority=NODE_PRIORITY + 10)
"""The hub has priority over the nodes: a frame that waits behind its own sender is late for all nodes."""


class RealtimeReport(NamedTuple):
    """The permissions that the machine granted."""

    scheduler: str
    """deadline: a reserved share of a CPU; fifo: a fixed priority; ordinary: any busy process delays it."""
    memory_locked: bool
    """Whether used pages stay in memory; where a limit applies, only the pages that exist so far."""
    timer_slack: bool
    """Whether the kernel's rounding of wake-ups (50 µs by default) is switched off."""


@cache
def libc() -> ctypes.CDLL | None:
    """Linux's C library; None elsewhere."""
    return ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


@cache
def is_user_mode_linux() -> bool:
    """Whether the kernel is user-mode Linux: one CPU, and the machine's file system as its root."""
    information = Path("/proc/cpuinfo")
    return information.exists() and "User Mode Linux" in information.read_text()


def become_realtime(reservation: Reservation) -> RealtimeReport:
    """Acquire a share of a CPU, locked memory and exact timers as far as permitted; settle the garbage."""
    settle_garbage()
    library = libc()
    if library is None:
        return RealtimeReport("ordinary", memory_locked=False, timer_slack=False)
    later = MCL_FUTURE if may_lock_all() else 0
    memory_locked = library.mlockall(MCL_CURRENT | later | MCL_ONFAULT) == 0
    timer_slack = library.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return RealtimeReport(take_scheduler(library, reservation), memory_locked, timer_slack)


def collect_rarely() -> None:
    """Make garbage collections rare, and skip the last one, whose work the system does when a process ends.

    Python's 700 allocations between two slow down imports and compiling; the last one took half a second.
    """
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)


def settle_garbage() -> None:
    """Collect garbage now, and exclude the surviving objects from later collections.

    A collection over all that a process has imported takes tens of milliseconds, under user-mode Linux a
    second.
    """
    gc.collect()
    gc.freeze()


def may_lock_all() -> bool:
    """Whether this process may lock any amount of memory.

    Without this right, a lock on future pages makes the first mapping beyond the limit fail (EAGAIN).
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit == resource.RLIM_INFINITY:
        return True
    status = Path("/proc/self/status").read_text() if Path("/proc/self/status").exists() else ""
    found = re.search(r"^CapEff:\s*([0-9a-f]+)$", status, re.MULTILINE)
    return found is not None and bool(int(found[1], 16) >> CAP_IPC_LOCK & 1)


def take_scheduler(library: ctypes.CDLL, reservation: Reservation) -> str:
    """Request a reservation, otherwise a fixed priority; ordinary users usually have the right to neither.

    Despite a fixed priority, ordinary processes that have waited for a second run for 50 ms (Linux's fair
    server); a reservation with a deadline of one tick precedes them. User-mode Linux accounts for
    reservations at its timer's 100 Hz and would therefore withdraw the CPU for tens of milliseconds.
    """
    number = SCHED_SETATTR.get(platform.machine())
    if number is not None and not is_user_mode_linux():
        runtime_ns, period_ns, _ = reservation
        attributes = SCHEDULING_ATTRIBUTES.pack(
            *(SCHEDULING_ATTRIBUTES.size, SCHED_DEADLINE, RESET_ON_FORK, 0, 0),
            *(runtime_ns, period_ns, period_ns, 0, 0),
        )
        if library.syscall(number, 0, attributes, 0) == 0:
            return "deadline"
    return "fifo" if take_fifo(reservation.priority) else "ordinary"


def take_fifo(priority: int) -> bool:
    """Request SCHED_FIFO; returns False if this user has no right to it, or the system none."""
    if libc() is None:
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def leave_realtime() -> None:
    """Return to ordinary scheduling, so that the work after a loop does not delay another node's loop."""
    if libc() is not None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def fixed_priority(priority: int) -> Iterator[None]:
    """Run the block with SCHED_FIFO, where this process has the right to it."""
    if libc() is None:
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    take_fifo(priority)
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, parameters)


def end_with_parent(number: signal.Signals) -> None:
    """Have the kernel send this process a signal when the one that started it ends, however it ends."""
    library = libc()
    if library is not None:
        library.prctl(PR_SET_PDEATHSIG, number, 0, 0, 0)


def die_with_parent() -> None:
    """Have the kernel kill this process when the one that started it ends, however it ends."""
    end_with_parent(signal.SIGKILL)
