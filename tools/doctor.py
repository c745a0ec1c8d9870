"""The machine's abilities for the bench, one check each, with the remedy for what is missing."""

import os
import platform
import re
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import distributions, requires
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from compilation.kernel_cache import KernelCacheError, root
from firmware_py.builds import board_tools
from hil.bus import BusError, provide
from hil.bus.can_socket import has_kernel_can
from hil.kernel import user_mode_linux
from hil.processes.own_network import NetworkError, enter_own_network
from hil.timing.clock import MonotonicClock
from hil.timing.realtime import BASELINE, RealtimeReport, become_realtime
from tools.fmu import linker

PACKAGES = "packages"
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


def checks() -> list[DoctorCheck]:
    """Run all checks, in about a second; nothing is compiled."""
    with ProcessPoolExecutor(1, get_context("fork")) as own_process:
        realtime, late_us, refusal = own_process.submit(bare_loop).result()
    fifo, lock = realtime.scheduler != "ordinary", realtime.memory_locked
    return [
        packages(),
        kernels(),
        DoctorCheck(
            "CAN in the kernel",
            has_kernel_can(),
            f"{load_modules('can', 'can-raw', 'vcan')}, or another kernel: vibrohil kernel -- COMMAND",
            f"Linux {platform.release()} opens {'an' if has_kernel_can() else 'no'} AF_CAN socket",
        ),
        private_vcan(),
        DoctorCheck(
            "rootless namespaces",
            not refusal,
            "sysctl kernel.unprivileged_userns_clone=1 kernel.apparmor_restrict_unprivileged_userns=0",
            refusal or "user and network namespaces of this user's own can be made",
        ),
        programs(
            "can-utils",
            "apt-get install can-utils, to watch a bus with candump",
            missing("candump", "cansend"),
        ),
        programs("user-mode Linux", user_mode_linux.REMEDY, user_mode_linux.missing_programs()),
        programs("emulated board", board_tools.REMEDY, board_tools.find_missing_tools()),
        programs("C compiler", linker.REMEDY, missing(linker.LINKER)),
        check_permission("SCHED_FIFO", fifo, "rtprio 30", "any busy process"),
        check_permission("mlockall", lock, "memlock unlimited", "a page fetched from disk"),
        machine_load(os.getloadavg()[0], os.cpu_count() or 1),
        wake_up(late_us),
        viewer(),
    ]


def bare_loop() -> tuple[RealtimeReport, list[float], str]:
    """The real-time permissions, the lateness of wake-ups in µs, and why no own network can be entered.

    It runs in a process of its own, whose priority and network end with it, and sleeps from deadline to
    deadline without work.
    """
    report, clock = become_realtime(BASELINE), MonotonicClock()
    start_ns = clock.now_ns() + PERIOD_NS
    late_us = []
    for tick in range(WAKE_UPS):
        clock.sleep_until(start_ns + tick * PERIOD_NS)
        late_us.append((clock.now_ns() - start_ns - tick * PERIOD_NS) * 1e-3)
    try:
        enter_own_network()
    except (NetworkError, OSError) as error:
        return report, late_us, str(error)
    return report, late_us, ""


def packages() -> DoctorCheck:
    """Whether the installed packages are those of the lock, with their modules."""
    wrong = package_faults(LOCK.read_text(), requires("vibrohil") or [])
    return DoctorCheck(PACKAGES, not wrong, "make setup", "; ".join(wrong) or f"as in {LOCK.name}")


def package_faults(lock: str, required: Sequence[str]) -> list[str]:
    """Return what is wrong with the installed packages by a lock file's text and the project's requirements.

    The lock may list a package several times, each with a marker for certain machines; such a package may be
    missing. No module is imported, which would take seconds: its files may be gone while the package's
    metadata and even its empty folder remain.
    """
    locked: dict[str, set[str]] = {}
    faults = []
    lines = re.findall(r"^([\w.-]+)==([^\s;\\]+)[ \\]*(;?)", lock, re.MULTILINE)
    for name, number, _ in lines:
        locked.setdefault(name, set()).add(number)
    optional = {name for name, _, marker in lines if marker}
    installed = {one.metadata["Name"].lower().replace("_", "-"): one.version for one in distributions()}
    for name, numbers in locked.items():
        if name not in installed:
            faults += [] if name in optional else [f"{name} is not installed"]
        elif installed[name] not in numbers:
            faults.append(f"{name} is {installed[name]}, locked at {' or '.join(sorted(numbers))}")
    for name in (re.split(r"[^\w.-]", one, maxsplit=1)[0] for one in required if "extra ==" not in one):
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
    name, remedy = "private vcan", f"{load_modules('vcan')}, or: vibrohil kernel -- COMMAND"
    try:
        with provide("vcan") as bus:
            return DoctorCheck(name, True, remedy, bus.address)
    except BusError as error:
        return DoctorCheck(name, False, remedy, str(error))


def programs(name: str, remedy: str, missing: Sequence[str]) -> DoctorCheck:
    """Whether the programs of an ability are installed."""
    return DoctorCheck(name, not missing, remedy, f"no {', no '.join(missing)}" if missing else "installed")


def missing(*names: str) -> list[str]:
    """Those of some programs that are not installed; `modprobe` may stand outside of a user's path."""
    return [
        name
        for name in names
        if shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") is None
    ]


def load_modules(*modules: str) -> str:
    """The command that loads modules of the kernel; without -a, modprobe takes the others as options."""
    command = f"modprobe -a {' '.join(modules)}"
    return f"apt-get install kmod (there is no modprobe), then {command}" if missing("modprobe") else command


def machine_load(load: float, cores: int) -> DoctorCheck:
    """Whether processors are free: a real-time run needs two, one for each loop."""
    return DoctorCheck(
        "load of the machine",
        load <= max(cores - 2, 0.5 * cores),
        "end what else runs, or run in lockstep; in real time the run is held up, or periods are missed",
        f"{load:.1f} processes want to run on {cores} cores, by the mean of the last minute",
    )


def check_permission(name: str, passed: bool, limit: str, delay: str) -> DoctorCheck:
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
