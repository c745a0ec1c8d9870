"""The machine's abilities for the bench, one check each, with the remedy for what is missing."""

import os
import platform
import re
import shutil
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware_py.builds import board_tools
from hil.bus import BusError, provide
from hil.bus.can_socket import has_kernel_can
from hil.bus.vcan import VcanError, enter_own_network
from hil.kernel import user_mode_linux
from hil.timing.clock import MonotonicClock
from hil.timing.realtime import BASELINE, RealtimeReport, become_realtime
from kernel_cache import KernelCacheError, root
from tools.fmu import linker

OLDEST_PYTHON = (3, 11)
LOCK = Path(__file__).parents[1] / "requirements.lock"
IMPORT_NAMES = {"python-can": "can", "rerun-sdk": "rerun"}
"""Packages whose import name differs from their distribution's name."""
PERIOD_NS, WAKE_UPS = 1_000_000, 500
WAKE_LIMIT_US = 500.0
"""Half a period: a firmware tick that is later than this starts after the plant's next tick."""
VULKAN_DRIVERS = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))


class DoctorCheck(NamedTuple):
    """One ability of the machine, with the remedy if it is missing and what was found."""

    name: str
    passed: bool
    remedy: str
    detail: str


class Conclusion(NamedTuple):
    """Whether scenarios can run here, and a sentence with the possible runs and the most useful remedy."""

    main_job_runs: bool
    sentence: str


USES = {
    "user-mode Linux": "real SocketCAN",
    "viewer": "the Rerun viewer",
    "SCHED_FIFO": "real time beside other work",
    "mlockall": "real time without page faults",
    "timer wake-up": "real time without overruns",
    "emulated board": "the firmware on an emulated Cortex-M7",
    "FMU linker": "`vibrohil export-fmu`",
}
"""The use of each check beyond lockstep and the local bus, the most useful first."""


def conclude(found: Sequence[DoctorCheck]) -> Conclusion:
    """State the runs that this machine allows, and the remedy for the most useful missing ability."""
    by_name = {check.name: check for check in found}
    for needed in ("Python", "packages"):
        if not by_name[needed].passed:
            return Conclusion(False, f"The bench cannot run here yet. {needed}: {by_name[needed].remedy}.")
    has_can = by_name["CAN in the kernel"].passed
    lacking = [
        name for name in USES if not by_name[name].passed and not (has_can and name == "user-mode Linux")
    ]
    can = "SocketCAN" if has_can else "SocketCAN under `vibrohil kernel`"
    buses = "" if "user-mode Linux" in lacking else f", and on {can}"
    runs = f"Here you can run every scenario in lockstep and, in real time, on the local bus{buses}"
    if not lacking:
        return Conclusion(True, f"{runs}; nothing is missing.")
    return Conclusion(True, f"{runs}. For {USES[lacking[0]]}: {by_name[lacking[0]].remedy}.")


def checks() -> list[DoctorCheck]:
    """Run all checks, in about a second; nothing is compiled."""
    realtime, late_us, refusal = in_own_process()
    return [
        python(),
        packages(),
        kernels(),
        DoctorCheck(
            "CAN in the kernel",
            has_kernel_can(),
            "modprobe can can-raw, or run under another kernel: vibrohil kernel -- COMMAND",
            f"Linux {platform.release()} opens {'an' if has_kernel_can() else 'no'} AF_CAN socket",
        ),
        private_vcan(),
        DoctorCheck(
            "rootless namespaces",
            not refusal,
            "sysctl kernel.unprivileged_userns_clone=1 kernel.apparmor_restrict_unprivileged_userns=0",
            refusal or "user and network namespaces of this user's own can be made",
        ),
        programs("user-mode Linux", user_mode_linux.REMEDY, user_mode_linux.missing_programs()),
        programs("emulated board", board_tools.REMEDY, board_tools.missing_tools()),
        programs("FMU linker", linker.REMEDY, [p for p in (linker.LINKER,) if not shutil.which(p)]),
        permitted("SCHED_FIFO", realtime.scheduler != "ordinary", "rtprio 30", "any busy process"),
        permitted("mlockall", realtime.memory_locked, "memlock unlimited", "a page fetched from disk"),
        wake_up(late_us),
        viewer(),
    ]


def in_own_process() -> tuple[RealtimeReport, list[float], str]:
    """The real-time permissions, the lateness of wake-ups in µs, and why no own network can be entered.

    A forked process asks, because its priority and its network end with it.
    """
    context = get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=bare_loop, args=(theirs,))
    child.start()
    found: tuple[RealtimeReport, list[float], str] = ours.recv()
    child.join()
    return found


def bare_loop(answers: Connection) -> None:
    """Sleep from deadline to deadline without work, then enter a network of its own; send what was found."""
    report, clock = become_realtime(BASELINE), MonotonicClock()
    start_ns = clock.now_ns() + PERIOD_NS
    late_us = []
    for tick in range(WAKE_UPS):
        clock.sleep_until(start_ns + tick * PERIOD_NS)
        late_us.append((clock.now_ns() - start_ns - tick * PERIOD_NS) * 1e-3)
    try:
        enter_own_network()
        refusal = ""
    except (VcanError, OSError) as error:
        refusal = str(error)
    answers.send((report, late_us, refusal))


def python() -> DoctorCheck:
    """Whether Python is recent enough."""
    remedy = "install Python 3.11 or newer, then: make clean setup PYTHON=/path/to/python3"
    detail = f"{platform.python_version()} at {sys.executable}"
    return DoctorCheck("Python", sys.version_info >= OLDEST_PYTHON, remedy, detail)


def packages() -> DoctorCheck:
    """Whether the installed packages are those of the lock, with their modules."""
    wrong = [*version_faults(LOCK.read_text()), *missing_modules()]
    return DoctorCheck("packages", not wrong, "make setup", "; ".join(wrong) or f"as in {LOCK.name}")


def version_faults(lock: str) -> list[str]:
    """Return the differences between the installed packages and the text of a lock file.

    The file may list a package several times, each with a marker for certain machines. A missing package is
    a fault only if it has no marker.
    """
    locked: dict[str, set[str]] = {}
    optional: set[str] = set()
    for name, number, marker in re.findall(r"^([\w.-]+)==([^\s;\\]+)[ \\]*(;?)", lock, re.MULTILINE):
        locked.setdefault(name, set()).add(number)
        if marker:
            optional.add(name)
    faults = []
    for name, numbers in locked.items():
        try:
            installed = version(name)
        except PackageNotFoundError:
            if name not in optional:
                faults.append(f"{name} is not installed")
            continue
        if installed not in numbers:
            faults.append(f"{name} is {installed}, locked at {' or '.join(sorted(numbers))}")
    return faults


def missing_modules() -> list[str]:
    """Return the project's requirements without their module; none is imported, which would take seconds.

    Files may be gone while the package's metadata and even its empty folder remain.
    """
    names = [
        re.split(r"[^\w.-]", one, maxsplit=1)[0]
        for one in requires("vibrohil") or []
        if "extra ==" not in one
    ]
    faults = []
    for name in names:
        module = IMPORT_NAMES.get(name, name.replace("-", "_"))
        found = find_spec(module)
        if found is None or found.origin is None:
            faults.append(f"{name} has no module {module}")
    return faults


def kernels() -> DoctorCheck:
    """Whether the folder of compiled kernels can be written and holds kernels."""
    name, remedy = "compiled kernels", "make setup, or set VIBROHIL_CACHE_DIR to a writable folder"
    try:
        folder = root()
    except KernelCacheError as error:
        return DoctorCheck(name, False, remedy, str(error))
    if not os.access(folder, os.W_OK):
        return DoctorCheck(name, False, remedy, f"{folder} cannot be written")
    compiled = sum(1 for _ in folder.rglob("*.nbc"))
    return DoctorCheck(name, compiled > 0, remedy, f"{compiled} in {folder}")


def private_vcan() -> DoctorCheck:
    """Whether a vcan can be made for a run alone."""
    name, remedy = "private vcan", "modprobe vcan, or: vibrohil kernel -- COMMAND"
    try:
        with provide("vcan") as bus:
            return DoctorCheck(name, True, remedy, bus.address)
    except BusError as error:
        return DoctorCheck(name, False, remedy, str(error))


def programs(name: str, remedy: str, missing: Sequence[str]) -> DoctorCheck:
    """Whether the programs of an ability are installed."""
    return DoctorCheck(name, not missing, remedy, f"no {', no '.join(missing)}" if missing else "installed")


def permitted(name: str, passed: bool, limit: str, delay: str) -> DoctorCheck:
    """Whether this user may have a real-time permission."""
    remedy = f"run as root, or give this user {limit} in /etc/security/limits.d and log in again"
    return DoctorCheck(name, passed, remedy, "allowed" if passed else f"refused: {delay} delays the loops")


def wake_up(late_us: Sequence[float]) -> DoctorCheck:
    """Whether the timer wakes a process in time."""
    p50_us, p99_us, worst_us = np.percentile(late_us, (50, 99, 100))
    return DoctorCheck(
        "timer wake-up",
        bool(p99_us <= WAKE_LIMIT_US),
        "end what else runs on this machine; allow real-time scheduling; give a virtual machine its own CPUs",
        f"late by {p50_us:.0f} µs p50, {p99_us:.0f} µs p99, {worst_us:.0f} µs worst of {WAKE_UPS} at 1 kHz",
    )


def viewer() -> DoctorCheck:
    """Whether the Rerun viewer can open a window: a display and a Vulkan driver."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    drivers = sorted(driver.name for folder in VULKAN_DRIVERS for driver in folder.glob("*.json"))
    screen = f"display {display}" if display else "no display: `vibrohil view` opens no window"
    return DoctorCheck(
        "viewer",
        bool(display and drivers) or sys.platform == "darwin",
        "vibrohil view --web, or on a display: apt-get install mesa-vulkan-drivers",
        f"{screen}; Vulkan drivers: {', '.join(drivers) or 'none'}",
    )
