"""Child processes: started, waited for, and always ended."""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

from hil.timing.realtime import end_with_parent
from text_input import RefusalError

READY = "ready"
"""First word that a child prints once it is warmed up and on the bus; more words may follow in the line."""
BAD_INPUT_STATUS = 4
"""The program's exit status if its input is invalid."""

READY_TIMEOUT_S = 600.0
"""Longest start of a child, with imports and kernels to compile, on a busy machine."""
STOP_TIMEOUT_S = 3.0
EXIT_TIMEOUT_S = 60.0
"""Additional time for a process whose first thread has ended, and whose others a busy host holds up."""
PIPE_BYTES = 1 << 16
BUSY_LOOK_S = 0.2
LOOK_S = 1.0
MOST_LOOKS_STOPPED = 5
"""Successive checks, `LOOK_S` apart, that find a starting child stopped by a signal before it is given up."""
SHOWN_LINES = 12


DEAD, STOPPED = "ZX", "Tt"
"""States of a process that has ended, and of one that was stopped by a signal; proc(5)."""


def state_of(pid: int) -> str:
    """The letter of a process's state; a letter of `DEAD` for none, and "R" where the system has no /proc.

    The first thread of a process may be dead while others still end.
    """
    if not Path("/proc/self/stat").exists() or pid == 0:
        return "R"
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return DEAD[0]


def has_stopped(pid: int) -> bool:
    """Whether a process is dead or was stopped by a signal; False where the system has no /proc."""
    return state_of(pid) in DEAD + STOPPED


def cpu_s(pid: int) -> float:
    """CPU time of a process in s; 0 where the system has no /proc or the process has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def is_busy(pid: int) -> bool:
    """Whether a process uses most of a CPU now."""
    before_s = cpu_s(pid)
    time.sleep(BUSY_LOOK_S)
    return cpu_s(pid) - before_s > 0.5 * BUSY_LOOK_S


def stop_requests() -> socket.socket:
    """Return a descriptor that becomes readable on SIGTERM, for `select`; Ctrl-C is left to the parent.

    A duplicate stays open to the end of the process, so that a signal during the program's end is no error.
    """
    readable, writable = socket.socketpair()
    readable.dup().detach()
    writable.setblocking(False)
    signal.set_wakeup_fd(writable.detach())
    signal.signal(signal.SIGTERM, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return readable


def report_to_parent(line: str) -> None:
    """In a child: write a line to standard output; ignored if the parent has ended."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), f"{line}\n".encode())


class Start(NamedTuple):
    """The common start time, and the first tick of a process that starts later."""

    t0_ns: int
    first_tick: int = 0


def read_start() -> Start:
    """In a child: read the start from standard input; the process exits if the parent has ended."""
    line = sys.stdin.readline()
    if not line:
        sys.exit()
    return Start(*map(int, line.split()))


class ChildError(RuntimeError):
    """A child ended, or stayed silent, when it should have been running."""


class ChildRefusalError(RefusalError, ChildError):
    """A process ended because its input is invalid; its last line says why."""


asked_to_end_with_parent = partial(end_with_parent, signal.SIGTERM)
"""Called in a child before its program begins, so that the child ends with the parent from the outset."""


class Child:
    """A child process with pipes for standard input and output; its errors go to a file or to our own.

    The child leads a process group of its own, so that Ctrl-C reaches the parent alone, which then stops all
    children in order. If the parent ends, the child gets SIGTERM from the kernel and its standard input ends.
    """

    def __init__(
        self, name: str, command: Sequence[str], errors: Path | None = None, descriptors: Sequence[int] = ()
    ) -> None:
        """`descriptors`: file descriptors of this process that the child inherits under the same numbers."""
        self.name = name
        self.errors = errors
        with ExitStack() as stack:
            error_file = None if errors is None else stack.enter_context(errors.open("wb"))
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=error_file,
                process_group=0,
                pass_fds=descriptors,
                preexec_fn=asked_to_end_with_parent,  # noqa: PLW1509  one system call, no lock
            )
        self._partial = b""
        self.killed_at_stop = False
        """Whether the child was killed because it did not end on request."""

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether the child has ended; does not wait."""
        return self._process.poll() is not None

    @property
    def succeeded(self) -> bool:
        """Whether the child has ended with status 0."""
        return self._process.poll() == 0

    def how_it_ended(self) -> str:
        """Describe the child's end, for example `firmware was killed by SIGKILL`."""
        status = self._process.poll()
        if status is None:
            return f"{self.name} is running"
        if status < 0:
            return f"{self.name} was killed by {signal.Signals(-status).name}"
        return f"{self.name} ended with status {status}"

    def last_errors(self) -> str:
        """The last lines that the child wrote to standard error."""
        if self.errors is None:
            return ""
        lines = self.errors.read_text(errors="replace").splitlines()
        return "\n".join(lines[-SHOWN_LINES:])

    def why(self) -> str:
        """The last error line of a child that ended with an error, to be appended to `how_it_ended`."""
        lines = self.last_errors().splitlines()
        return f": {lines[-1]}" if lines and (self._process.poll() or 0) > 0 else ""

    def read_line(self, timeout_s: float = READY_TIMEOUT_S) -> str:
        """Return the child's next line; raises `ChildError` if it ends, stays silent or stays stopped."""
        assert self._process.stdout is not None
        descriptor = self._process.stdout.fileno()
        line = b""
        deadline = time.monotonic() + timeout_s
        looks_stopped = 0
        while not line.endswith(b"\n"):
            rest_s = deadline - time.monotonic()
            readable, _, _ = select.select([descriptor], [], [], min(LOOK_S, max(0.0, rest_s)))
            if not readable:
                looks_stopped = looks_stopped + 1 if has_stopped(self.pid) else 0
                if looks_stopped == MOST_LOOKS_STOPPED:
                    raise ChildError(f"{self.name} was stopped by a signal before it was ready")
                if rest_s <= 0.0:
                    silence = f"{self.name} wrote nothing for {timeout_s:g} s"
                    raise ChildError(f"{silence}\n{self.last_errors()}".rstrip())
                continue
            byte = os.read(descriptor, 1)
            if not byte:
                if not self.wait(EXIT_TIMEOUT_S):
                    raise ChildError(f"{self.name} has closed its output and not ended")
                refused = self._process.poll() == BAD_INPUT_STATUS
                raise (ChildRefusalError if refused else ChildError)(
                    f"{self.how_it_ended()} before it was ready\n{self.last_errors()}".rstrip()
                )
            line += byte
        return line.decode().rstrip("\n")

    def read_available(self) -> str:
        """The child's whole lines that have arrived and were not read, without waiting for more."""
        stdout = self._process.stdout
        assert stdout is not None
        while not stdout.closed and select.select([stdout], [], [], 0.0)[0]:
            if not (chunk := os.read(stdout.fileno(), PIPE_BYTES)):
                break
            self._partial += chunk
        lines, end, self._partial = self._partial.rpartition(b"\n")
        return (lines + end).decode(errors="replace")

    def wait_ready(self, timeout_s: float = READY_TIMEOUT_S) -> str:
        """Wait for the line that starts with `ready` and return the rest of the line."""
        line = self.read_line(timeout_s)
        word, _, rest = line.partition(" ")
        if word != READY:
            raise ChildError(f"{self.name} wrote {line!r}; wanted {READY!r}")
        return rest

    def start(self, start: Start) -> None:
        """Send the child the start for which it waits in `read_start`."""
        self.tell(" ".join(map(str, start)))

    def tell(self, line: str) -> None:
        """Write a line to the child's standard input."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise ChildError(f"{self.how_it_ended()} before it received {line!r}") from error

    def signal(self, number: signal.Signals) -> None:
        """Send the child a signal, unless it has ended."""
        if self._process.poll() is None:
            self._process.send_signal(number)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the child's end; returns False after `timeout_s`."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self, at_work_s: float = 0.0) -> str:
        """Ask the child to end, kill it if it does not, and return the rest of its standard output.

        `at_work_s`: additional time before the kill for a child that is running, not stopped by a signal.
        """
        if self._process.poll() is None:
            self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            return self._last_output(STOP_TIMEOUT_S)
        state = state_of(self.pid)
        if state in DEAD:
            at_work_s = max(at_work_s, EXIT_TIMEOUT_S)
        if state not in STOPPED:
            with suppress(subprocess.TimeoutExpired):
                return self._last_output(at_work_s)
        self._process.kill()
        self.killed_at_stop = True
        return self._last_output()

    def _last_output(self, timeout_s: float | None = None) -> str:
        """Wait for the child's end, and return the rest of its standard output; may raise TimeoutExpired."""
        rest = self._process.communicate(timeout=timeout_s)[0]
        partial, self._partial = self._partial, b""
        return (partial + rest).decode(errors="replace")
