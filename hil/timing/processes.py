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

from hil.timing.clock import MonotonicClock
from hil.timing.patient_clock import PatientClock, Row, has_stopped
from hil.timing.realtime import end_with_parent

READY = "ready"
"""The first line a child prints once it is warmed up and on the bus; more words may follow it."""
BAD_INPUT_STATUS = 4
"""The program's exit status where its input is at fault."""

STOP_TIMEOUT_S = 3.0
LOOK_S = 1.0
MOST_LOOKS_STOPPED = 5
"""One after the other, each `LOOK_S` long, at a child that is not ready and that a signal has stopped."""
SHOWN_LINES = 12


def stop_requests() -> socket.socket:
    """A descriptor that becomes readable on SIGTERM, to sleep on; Ctrl-C is left to the parent.

    A second one like it stays open to the end of the process, so that a signal that comes while the program
    ends is no error.
    """
    readable, writable = socket.socketpair()
    readable.dup().detach()
    writable.setblocking(False)
    signal.set_wakeup_fd(writable.detach())
    signal.signal(signal.SIGTERM, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return readable


def report_to_parent(line: str) -> None:
    """In a child: write a line to standard output; where the parent is gone, nobody misses it."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), f"{line}\n".encode())


class Start(NamedTuple):
    """When all begin, and the first tick of a process that comes later.

    `shared` is the descriptor of what patient clocks share (`hil.timing.patient_clock`), and `row` this
    process's place there; on the wall clock -1.
    """

    t0_ns: int
    first_tick: int = 0
    shared: int = -1
    row: int = -1

    def clock(self) -> MonotonicClock | PatientClock:
        """The clock of the process that received it."""
        return MonotonicClock() if self.shared < 0 else PatientClock(self.shared, Row(self.row))


def read_start() -> Start:
    """In a child: the start from standard input; the process ends here if the parent has."""
    line = sys.stdin.readline()
    if not line:
        sys.exit()
    return Start(*map(int, line.split()))


class ChildError(RuntimeError):
    """A child that ended, or stayed silent, when it should have been running."""


class ChildRefusalError(ChildError):
    """A process that ends as its input is at fault, which its last line says."""


asked_to_end_with_parent = partial(end_with_parent, signal.SIGTERM)
"""Called in a child before its program begins, so that not even its start outlives the parent."""


class Child:
    """One process: its standard input and output are ours, its errors go to a file or to our own.

    It leads a process group of its own, so that Ctrl-C reaches the parent alone, which then stops all in
    order. When the parent is gone, it gets SIGTERM from the kernel, and its standard input ends.
    """

    def __init__(
        self, name: str, command: Sequence[str], errors: Path | None = None, descriptors: Sequence[int] = ()
    ) -> None:
        """`descriptors`: those of ours that it has too, under the same numbers."""
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
        self.killed_at_stop = False
        """Whether it had to be killed, since it did not end when asked to."""

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it has ended, noticed without waiting."""
        return self._process.poll() is not None

    @property
    def succeeded(self) -> bool:
        """Whether it has ended of its own accord and in order."""
        return self._process.poll() == 0

    def how_it_ended(self) -> str:
        """The end in words: `firmware was killed by SIGKILL`."""
        status = self._process.poll()
        if status is None:
            return f"{self.name} is running"
        if status < 0:
            return f"{self.name} was killed by {signal.Signals(-status).name}"
        return f"{self.name} ended with status {status}"

    def last_errors(self) -> str:
        """The last lines it wrote to standard error."""
        if self.errors is None:
            return ""
        lines = self.errors.read_text(errors="replace").splitlines()
        return "\n".join(lines[-SHOWN_LINES:])

    def why(self) -> str:
        """The last error of a process that ended by one, to be put behind `how_it_ended`."""
        lines = self.last_errors().splitlines()
        return f": {lines[-1]}" if lines and (self._process.poll() or 0) > 0 else ""

    def read_line(self, timeout_s: float) -> str:
        """The next line of its standard output; raises where it ends, stays silent or stays stopped."""
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
                self._process.wait(STOP_TIMEOUT_S)
                refused = self._process.poll() == BAD_INPUT_STATUS
                raise (ChildRefusalError if refused else ChildError)(
                    f"{self.how_it_ended()} before it was ready\n{self.last_errors()}".rstrip()
                )
            line += byte
        return line.decode().rstrip("\n")

    def wait_ready(self, timeout_s: float) -> str:
        """Wait for the line that starts with `ready`; gives the rest of it."""
        line = self.read_line(timeout_s)
        word, _, rest = line.partition(" ")
        if word != READY:
            raise ChildError(f"{self.name} wrote {line!r}; wanted {READY!r}")
        return rest

    def start(self, start: Start) -> None:
        """Send it the time to begin; it waits for that in `read_start`."""
        line = " ".join(map(str, start))
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise ChildError(f"{self.how_it_ended()} before it received {line!r}") from error

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal; one that has ended gets none."""
        if not self.ended:
            self._process.send_signal(number)

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; False if it has not come in time."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self, at_work_s: float = 0.0) -> str:
        """Ask it to end, insist after a while, and give what it last said on standard output.

        `at_work_s`: how much longer it has if it is at work, not stopped by a signal.
        """
        if not self.ended:
            self._process.terminate()
        for patience_s in (STOP_TIMEOUT_S, at_work_s):
            with suppress(subprocess.TimeoutExpired):
                return self._process.communicate(timeout=patience_s)[0].decode(errors="replace")
            if has_stopped(self.pid):
                break
        self._process.kill()
        self.killed_at_stop = True
        return self._process.communicate()[0].decode(errors="replace")
