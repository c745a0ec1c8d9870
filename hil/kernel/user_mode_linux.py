"""Runs a command under user-mode Linux, whose kernel has SocketCAN even if the machine's kernel has none.

User-mode Linux is a Linux kernel that runs as an ordinary process. Its root is the machine's own file
system (hostfs), so a command finds the same files, programs and virtual environment as outside, plus a real
`vcan0`. Nothing else is shared: the kernel has its own processes, loopback, /dev, /proc, /sys and /dev/shm.

Command and kernel share one temporary folder:

    init, command     the guest's first process, and the script it runs: environment, folder, command
    standard input    of the kernel is the guest's first serial line: a signal's name a line is sent to
                      all guest processes; its end (this process was killed) removes the
                      folder and halts the guest
    stdout, stderr    the command's, written through hostfs at once and copied from here while it runs,
                      so that the kernel's own messages never mix with them
    console           the kernel's messages, shown when it fails
    booted, failed    written when the guest has booted; the reason if its set-up failed
    status            the command's exit status, which the kernel's own exit status does not carry
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import BinaryIO, Final

from hil.kernel.registers import COMPILER, RegistersError, has_amx, make_library
from hil.timing.realtime import NODE_PRIORITY
from text_input import RefusalError

KERNEL: Final = "linux.uml"
GUEST_MEMORY: Final = "4G"  # half of it may hold traces: enough for a quarter of an hour in real time
REMEDY: Final = "install Debian's packages: apt-get install user-mode-linux busybox gcc libc6-dev"
BOOT_LIMIT_S: Final = 60.0  # boots in 1 to 3 s; twenty times as long on a busy machine
DELIVERY_PRIORITY: Final = NODE_PRIORITY + 10  # the guest's thread that delivers frames precedes nodes
PRIORITY: Final = 20  # above ordinary processes, below the machine's own interrupt threads at 50
GRACE_S: Final = 10.0  # time for a signalled command to end its children and close its log
POLL_S: Final = 0.02  # period of copying the command's output: live for a reader, negligible CPU time
CONSOLE_LINES: Final = 15  # of the kernel's last messages in an error

# Runs as process 1. The command is in the foreground because a shell starts background processes with SIGINT
# ignored. `kill -1` signals every process but this shell and process 1, as Ctrl-C signals a terminal's group.
# Pages of memory-mapped files reach hostfs when the guest writes them out: within 2 s because of the two
# settings (30 s by default), and by `sync` at the end. The guest accounts for CPU time by sampling at 100 Hz,
# and at these samples a loop at 1 kHz is either always or never running: a limit on real-time processes would
# stop a process that takes a fifth of the CPU. Frames that the kernel cannot deliver at once, for example
# after a host stall, are left to ksoftirqd: at its ordinary priority nodes received no frames for up to
# 70 ms. The command has a shell of its own, so that messages of the waiting shell such as "Killed" go to the
# console.
INIT: Final = """\
#!@BUSYBOX@ sh
folder=@FOLDER@
busybox() { @BUSYBOX@ "$@"; }
halt() { busybox sync; busybox poweroff -f; }
fail() { echo "$1" > "$folder/failed"; halt; }

busybox mount -t proc proc /proc
busybox mount -t sysfs sysfs /sys
busybox mkdir -p /dev/shm /dev/pts
busybox mount -t tmpfs tmpfs /dev/shm || fail "no /dev/shm"
busybox mount -t devpts devpts /dev/pts
busybox ln -sf /proc/self/fd /dev/fd
echo 100 > /proc/sys/vm/dirty_expire_centisecs
echo 100 > /proc/sys/vm/dirty_writeback_centisecs
echo -1 > /proc/sys/kernel/sched_rt_runtime_us

modules=/usr/lib/uml/modules/$(busybox uname -r)/kernel
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    busybox insmod "$modules/$module".ko* || fail "cannot load $modules/$module"
done
busybox ip link set lo up || fail "cannot bring up lo"
busybox ip link add dev vcan0 type vcan || fail "cannot create vcan0"
busybox ip link set vcan0 up || fail "cannot bring up vcan0"
@CHRT@ --fifo --pid @DELIVERY_PRIORITY@ "$(busybox pidof ksoftirqd/0)" || fail "cannot favour ksoftirqd"

{ while read -r name; do kill -"$name" -1; done; busybox rm -r "$folder"; halt; } < /dev/ttyS0 &
echo > "$folder/booted"
( exec @BUSYBOX@ sh "$folder/command" < /dev/null > "$folder/stdout" 2> "$folder/stderr" )
echo $? > "$folder/status"
halt
"""


class UmlError(RefusalError, ValueError):
    """The command cannot start: a bad argument, or no user-mode Linux; the message names the remedy."""


class UmlDeathError(RefusalError, RuntimeError):
    """User-mode Linux did not boot, or died under the command; the message has its last output and remedy."""


def run_in_kernel(command: Sequence[str], memory: str | None = None) -> int:
    """Run `command` under user-mode Linux and return its exit status, 128 + n after signal n.

    Working directory and environment are the caller's, with the programs of this Python environment first.
    The command's output is copied to standard output and error while it runs; its standard input is empty.
    SIGINT and SIGTERM reach every process in the guest; the guest has `GRACE_S` to end by itself, less if a
    second signal follows.

    `memory` is the guest's memory, such as "8G" (default `GUEST_MEMORY`); the machine provides only the pages
    in use. The kernel stays on one CPU, the last that this process may use: it serves all its processes by
    stopping and continuing them, and moving between CPUs makes each switch tens of times slower.
    """
    if not command:
        raise UmlError("no command to run under user-mode Linux; give one after --")
    if shutil.which(command[0], path=_search_path()) is None:
        raise UmlError(
            f"no program {command[0]!r} to run under user-mode Linux; give its path or extend PATH"
        )
    memory = memory or GUEST_MEMORY
    if not re.fullmatch(r"[1-9][0-9]*[MG]", memory):
        raise UmlError(f"memory of user-mode Linux: got {memory!r}, wanted a number with M or G such as 4G")
    kernel, busybox = _program(KERNEL), _program("busybox")
    with tempfile.TemporaryDirectory(prefix="vibrohil-kernel-") as name:
        folder = Path(name)
        _write_guest(folder, busybox, command)
        preloaded = _preload(folder)
        with (folder / "console").open("wb") as console, _on_one_cpu():
            process = subprocess.Popen(
                [
                    kernel,
                    f"mem={memory}",
                    *("root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw"),
                    f"init={folder / 'init'}",
                    *("con=null", "con0=null,fd:1", "ssl0=fd:0,null"),
                    f"uml_dir={folder}/",
                ],
                stdin=subprocess.PIPE,
                stdout=console,
                stderr=subprocess.STDOUT,
                env={"PATH": os.defpath, "HOME": name, "TMPDIR": _memory_folder(memory), **preloaded},
                start_new_session=True,
            )
            favour = _Favour(process.pid)
        try:
            return _attend(process, folder, favour)
        finally:
            _end(process)


def _program(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        raise UmlError(f"{name} is not installed, so no user-mode Linux here; {REMEDY}")
    return path


def missing_programs() -> list[str]:
    """The programs that user-mode Linux needs on this machine and that are not installed."""
    needed = (KERNEL, "busybox", *((COMPILER,) if _needs_library() else ()))
    return [name for name in needed if shutil.which(name) is None]


def _needs_library() -> bool:
    cpuinfo = Path("/proc/cpuinfo")  # of Linux alone; `vibrohil doctor` asks elsewhere, too
    return cpuinfo.exists() and has_amx(cpuinfo.read_text())


def _preload(folder: Path) -> dict[str, str]:
    """The environment that gives the kernel the library which it needs on processors with AMX."""
    if not _needs_library():
        return {}
    try:
        return {"LD_PRELOAD": str(make_library(folder))}
    except RegistersError as error:
        raise UmlError(str(error)) from error


def _write_guest(folder: Path, busybox: str, command: Sequence[str]) -> None:
    """Write the guest's start files; the guest removes the file with the environment after reading it."""
    init = folder / "init"
    values = {
        "@BUSYBOX@": shlex.quote(busybox),
        "@FOLDER@": shlex.quote(str(folder)),
        "@CHRT@": shlex.quote(_program("chrt")),
        "@DELIVERY_PRIORITY@": str(DELIVERY_PRIORITY),
    }
    init.write_text(re.sub("|".join(values), lambda found: values[found[0]], INIT))
    init.chmod(0o700)
    lines = [f"{shlex.quote(busybox)} rm {shlex.quote(str(folder / 'command'))}"]
    lines += [f"export {key}={shlex.quote(value)}" for key, value in _environment().items()]
    lines += [f"cd {shlex.quote(str(Path.cwd()))} || exit 1", f"exec {shlex.join(command)}"]
    (folder / "command").touch(mode=0o600)
    (folder / "command").write_text("\n".join(lines) + "\n")
    (folder / "stdout").touch()
    (folder / "stderr").touch()


def _search_path() -> str:
    """Return the folder of this Python environment's programs followed by the caller's PATH."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


def _environment() -> dict[str, str]:
    """Return the command's environment: the caller's, with colour and width set if the output is a terminal.

    The command writes to files, so it cannot detect the terminal itself.
    """
    environment = {
        key: value for key, value in os.environ.items() if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", key)
    }
    environment["PATH"] = _search_path()
    environment["VIBROHIL_OUTER_USER"] = str(os.geteuid())  # owns this user's files in the guest too
    if sys.stdout.isatty() and sys.stderr.isatty():
        environment.setdefault("FORCE_COLOR", "1")
        environment.setdefault("COLUMNS", str(shutil.get_terminal_size().columns))
    return environment


def _memory_folder(memory: str) -> str:
    """Return a folder for the file that backs the guest's memory: /dev/shm if it has room and may hold code.

    Containers often give a /dev/shm of 64 MB or one mounted noexec; the guest would die of a bus error in it.
    """
    size = int(memory[:-1]) << {"M": 20, "G": 30}[memory[-1]]
    shm = Path("/dev/shm")
    if shm.is_dir() and os.access(shm, os.W_OK):
        stat = os.statvfs(shm)
        if stat.f_bavail * stat.f_frsize >= size and not stat.f_flag & os.ST_NOEXEC:
            return str(shm)
    return tempfile.gettempdir()


@contextmanager
def _on_one_cpu() -> Iterator[None]:
    """Keep this thread, and every process that it starts within the block, on one CPU, the last allowed."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


class _Favour:
    """Gives the guest real-time priority, where this user may: its kernel, and one level below its processes.

    Each guest process is a host process, a child of the kernel. The kernel must be able to interrupt it: at
    the kernel's own priority a process that computes would keep the CPU regardless of timers.
    """

    def __init__(self, kernel_pid: int) -> None:
        self._children = Path(f"/proc/{kernel_pid}/task/{kernel_pid}/children")
        self._known: set[int] = set()
        with suppress(PermissionError):
            os.sched_setscheduler(
                kernel_pid, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY)
            )

    def follow(self) -> None:
        """Set the priority of new guest processes."""
        try:
            children = set(map(int, self._children.read_text().split()))
        except (FileNotFoundError, ProcessLookupError):  # the kernel has halted
            return
        for pid in children - self._known:
            with suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(PRIORITY - 1))
        self._known = children


def _attend(process: subprocess.Popen[bytes], folder: Path, favour: _Favour) -> int:
    """Copy the command's output until the kernel has halted; return the command's exit status."""
    started_s = time.monotonic()
    with (
        _signals_passed_on(process) as passed,
        (folder / "stdout").open("rb") as stdout,
        (folder / "stderr").open("rb") as stderr,
    ):
        streams = ((stdout, sys.stdout.buffer), (stderr, sys.stderr.buffer))
        running = True
        while running:
            with suppress(subprocess.TimeoutExpired):
                process.wait(POLL_S)
                running = False
            favour.follow()
            for source, sink in streams:
                _copy(source, sink)
            now_s = time.monotonic()
            if not (folder / "booted").exists() and running and now_s - started_s > BOOT_LIMIT_S:
                raise UmlDeathError(_death(folder, f"has not booted within {BOOT_LIMIT_S:.0f} s"))
            if running and passed and (len(passed) > 1 or now_s - passed[0][1] > GRACE_S):
                return 128 + passed[0][0]
    return _status(folder)


def _copy(source: BinaryIO, sink: BinaryIO) -> None:
    """Copy what has been added to `source` since the last call."""
    if chunk := source.read():
        sink.write(chunk)
        sink.flush()


def _status(folder: Path) -> int:
    """Return the status that the guest wrote; raises `UmlDeathError` with the reason if it wrote none."""
    failed, status = folder / "failed", folder / "status"
    if failed.exists():
        raise UmlDeathError(_death(folder, f"could not be set up: {failed.read_text().strip()}"))
    if not status.exists():
        when = "while the command ran" if (folder / "booted").exists() else "before it had booted"
        raise UmlDeathError(_death(folder, f"died {when}"))
    return int(status.read_text())


def _death(folder: Path, what: str) -> str:
    """Return an error text: the failure, the kernel's last messages, and the remedy."""
    console = (folder / "console").read_text(errors="replace").splitlines()
    without_call_traces = [line for line in console if "[<" not in line]
    return "\n".join(
        [
            f"user-mode Linux {what}; its last messages:",
            *(f"    {line}" for line in without_call_traces[-CONSOLE_LINES:]),
            "It needs ptrace (in a container: --cap-add SYS_PTRACE), enough memory for the command, and as "
            "much room in /dev/shm or the temporary folder",
        ]
    )


@contextmanager
def _signals_passed_on(process: subprocess.Popen[bytes]) -> Iterator[list[tuple[int, float]]]:
    """Forward SIGINT and SIGTERM to the guest's processes; yields the signals received, with times in s."""
    passed: list[tuple[int, float]] = []
    control = process.stdin
    assert control is not None

    def pass_on(number: int, _frame: FrameType | None) -> None:
        passed.append((number, time.monotonic()))
        with suppress(BrokenPipeError):  # the kernel has just halted
            os.write(control.fileno(), signal.Signals(number).name.removeprefix("SIG").encode() + b"\n")

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield passed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the kernel with everything in it: its guest processes are host processes of its session."""
    with suppress(ProcessLookupError):  # the kernel has halted with all its processes
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert process.stdin is not None
    process.stdin.close()
