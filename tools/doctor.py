"""The machine's abilities for the bench, one check each, with the remedy for what is missing."""

import importlib
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from firmware_py.builds.board import REMEDY as INSTALL_BOARD
from firmware_py.builds.board import missing_tools
from hil.bench.workers import alive, results
from hil.bus import BusError, provide
from hil.bus.can_socket import has_kernel_can
from hil.bus.uml import REMEDY as INSTALL_UML
from hil.bus.vcan import VcanError, enter_own_network
from hil.timing.clock import MonotonicClock
from hil.timing.realtime import BASELINE, RealtimeReport, become_realtime
from plant_sim.kernels import KernelCacheError, cache_folder

OLDEST_PYTHON = (3, 11)
LOCK = Path(__file__).parents[1] / "requirements.lock"
IMPORT_NAMES = {"python-can": "can", "rerun-sdk": "rerun"}
"""Packages whose import name differs from their distribution's name."""
PERIOD_NS = 1_000_000
WAKE_UPS = 2000
WAKE_LIMIT_US = 500.0
"""Half a period: a firmware tick that is later than this starts after the plant's next tick."""
VULKAN_DRIVERS = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))

Answer = TypeVar("Answer")


class DoctorCheck(NamedTuple):
    """One ability of the machine, present or missing."""

    name: str
    passed: bool
    remedy: str
    """The remedy if the check fails; it is stated in every case."""
    detail: str
    """The finding."""


class Conclusion(NamedTuple):
    """Whether scenarios can run here, and a sentence with the possible runs and the most useful remedy."""

    main_job_runs: bool
    sentence: str


REST = {
    "user-mode Linux": "real SocketCAN",
    "viewer": "the Rerun viewer",
    "SCHED_FIFO": "real time beside other work",
    "mlockall": "real time without page faults",
    "timer wake-up": "real time without overruns",
    "emulated board": "the firmware on an emulated Cortex-M7",
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
        (check, REST[check.name])
        for check in sorted(
            found, key=lambda check: list(REST).index(check.name) if check.name in REST else 0
        )
        if check.name in REST and not check.passed and not (has_can and check.name == "user-mode Linux")
    ]
    can = "SocketCAN" if has_can else "SocketCAN under `vibrohil kernel`"
    buses = "" if any(what == "real SocketCAN" for _, what in lacking) else f", and on {can}"
    runs = f"Here you can run every scenario in lockstep and, in real time, on the local bus{buses}"
    if not lacking:
        return Conclusion(True, f"{runs}; nothing is missing.")
    first, what = lacking[0]
    return Conclusion(True, f"{runs}. For {what}: {first.remedy}.")


def checks() -> list[DoctorCheck]:
    """Run all checks; they take about five seconds."""
    realtime, wake_us = _in_own_process(_bare_loop)
    return [
        _python(),
        _packages(),
        _kernels(),
        _kernel_can(),
        _vcan(),
        _namespaces(),
        _user_mode_linux(),
        _board(),
        DoctorCheck(
            "SCHED_FIFO",
            realtime.scheduler != "ordinary",
            "run as root, or give this user rtprio 30 in /etc/security/limits.d and log in again",
            f"allowed: {realtime.scheduler}"
            if realtime.scheduler != "ordinary"
            else "refused: any busy process delays the loops",
        ),
        DoctorCheck(
            "mlockall",
            realtime.memory_locked,
            "run as root, or give this user memlock unlimited in /etc/security/limits.d and log in again",
            "allowed" if realtime.memory_locked else "refused: a page fetched from disk delays the loops",
        ),
        _wake_up(wake_us),
        _viewer(),
    ]


def _in_own_process(ask: Callable[[], Answer]) -> Answer:
    """Return `ask()`, computed in a new process: a change of the process's priority ends with the process."""
    [(_, answer)] = results(_answer, [ask], processes=1)
    return alive(answer)


def _answer(ask: Callable[[], Answer]) -> Answer:
    return ask()


def _python() -> DoctorCheck:
    return DoctorCheck(
        "Python",
        sys.version_info >= OLDEST_PYTHON,
        "install Python 3.11 or newer, then: make clean setup PYTHON=/path/to/python3",
        f"{platform.python_version()} at {sys.executable}",
    )


def _packages() -> DoctorCheck:
    wrong = [*version_faults(LOCK.read_text()), *_import_faults()]
    return DoctorCheck(
        "packages", not wrong, "make setup", "; ".join(wrong) or f"as in {LOCK.name}, and they import"
    )


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


def _import_faults() -> list[str]:
    """Return the project's requirements that cannot be imported, each with the error."""
    faults = []
    for requirement in requires("vibrohil") or []:
        if "extra ==" in requirement:
            continue
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            importlib.import_module(IMPORT_NAMES.get(name, name.replace("-", "_")))
        except ImportError as error:
            faults.append(f"{name} does not import: {error}")
    return faults


def _kernels() -> DoctorCheck:
    name, remedy = "compiled kernels", "make setup, or set VIBROHIL_CACHE_DIR to a writable folder"
    try:
        folder = cache_folder()
    except KernelCacheError as error:
        return DoctorCheck(name, False, remedy, str(error))
    if not os.access(folder, os.W_OK):
        return DoctorCheck(name, False, remedy, f"{folder} cannot be written")
    compiled = sum(1 for _ in folder.rglob("*.nbc"))
    return DoctorCheck(name, compiled > 0, remedy, f"{compiled} in {folder}")


def _kernel_can() -> DoctorCheck:
    present = has_kernel_can()
    return DoctorCheck(
        "CAN in the kernel",
        present,
        "modprobe can can-raw, or run under another kernel: vibrohil kernel -- COMMAND",
        "AF_CAN sockets open" if present else f"Linux {platform.release()} opens no AF_CAN socket",
    )


def _vcan() -> DoctorCheck:
    name, remedy = "private vcan", "modprobe vcan, or: vibrohil kernel -- COMMAND"
    try:
        with provide("vcan") as bus:
            return DoctorCheck(name, True, remedy, bus.address)
    except BusError as error:
        return DoctorCheck(name, False, remedy, str(error))


def _namespaces() -> DoctorCheck:
    name = "rootless namespaces"
    remedy = "sysctl kernel.unprivileged_userns_clone=1 kernel.apparmor_restrict_unprivileged_userns=0"
    try:
        _in_own_process(enter_own_network)
    except (VcanError, OSError) as error:
        return DoctorCheck(name, False, remedy, str(error))
    return DoctorCheck(name, True, remedy, "user and network namespaces of this user's own can be made")


def _user_mode_linux() -> DoctorCheck:
    found = {program: shutil.which(program) for program in ("linux.uml", "busybox")}
    return DoctorCheck(
        "user-mode Linux",
        all(found.values()),
        INSTALL_UML,
        ", ".join(path or f"no {program}" for program, path in found.items()),
    )


def _board() -> DoctorCheck:
    missing = missing_tools()
    found = f"no {', no '.join(missing)}" if missing else "compiler, C library and emulator are there"
    return DoctorCheck("emulated board", not missing, INSTALL_BOARD, found)


def _bare_loop() -> tuple[RealtimeReport, list[float]]:
    """Sleep from deadline to deadline without work; return the granted privileges and all delays in µs."""
    report = become_realtime(BASELINE)
    clock = MonotonicClock()
    start_ns = clock.now_ns() + PERIOD_NS
    late_us = []
    for tick in range(WAKE_UPS):
        deadline_ns = start_ns + tick * PERIOD_NS
        clock.sleep_until(deadline_ns)
        late_us.append((clock.now_ns() - deadline_ns) * 1e-3)
    return report, late_us


def _wake_up(late_us: list[float]) -> DoctorCheck:
    p50_us, p99_us, worst_us = np.percentile(late_us, (50, 99, 100))
    return DoctorCheck(
        "timer wake-up",
        bool(p99_us <= WAKE_LIMIT_US),
        "end what else runs on this machine; allow real-time scheduling; give a virtual machine its own CPUs",
        f"late by {p50_us:.0f} µs p50, {p99_us:.0f} µs p99, {worst_us:.0f} µs worst of {WAKE_UPS} at 1 kHz",
    )


def _viewer() -> DoctorCheck:
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    virtual = shutil.which("xvfb-run")
    drivers = sorted(driver.name for folder in VULKAN_DRIVERS for driver in folder.glob("*.json"))
    screen = f"display {display}" if display else f"no display, {virtual or 'no xvfb-run'}"
    return DoctorCheck(
        "viewer",
        bool((display or virtual) and drivers) or sys.platform == "darwin",
        "vibrohil view --web, or: apt-get install xvfb mesa-vulkan-drivers",
        f"{screen}; Vulkan drivers: {', '.join(drivers) or 'none'}",
    )
