"""Functions that all kills share: start the program, send the signal, and find what remains afterwards."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from hil.judge.verdict import KILLED

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, signal.SIGSTOP)
FINAL = (signal.SIGKILL, signal.SIGSTOP)
"""Signals after which a process cannot act; a stopped process is killed later."""
PARENT = "the program"
"""Name of the process that was started and that starts the other processes."""
REPORT = "report"
"""Name of the stage after the last run, in which the report is written."""
SCENARIO = """
title = "It is killed"
scene = "table1-motor-soft"
[firmware.start]
rise_s = 1.0
[script]
duration_s = 3.0
[[script.commands]]
at_s = 0.2
request = "run"
target_ratio = 1.1
[[checks]]
name = "impact_count"
high = 1e6
"""
GONE_S = 2.0
START_LIMIT_S = 180.0
END_LIMIT_S = 120.0
LOOK_S = 0.01


class Kill(NamedTuple):
    """A kill: its process, signal, stage and time; `of` is the clock of a run, `suite` or `campaign`."""

    of: str
    process: str
    number: signal.Signals
    stage: str
    at_s: float

    @property
    def is_of_program(self) -> bool:
        """Whether the program itself receives the signal, not a process that it has started."""
        return self.process == PARENT

    @property
    def signal_name(self) -> str:
        """Name of the signal in the program's messages."""
        return "Ctrl-C" if self.number == signal.SIGINT else self.number.name

    @property
    def programs_cause(self) -> str:
        """Cause that must be named if the program itself received the signal."""
        return KILLED if self.number in FINAL else f"interrupted by {self.signal_name}"

    def sent_to(self, pid: int) -> bool:
        """Send the signal; return whether the process still existed."""
        return signalled(pid, self.number)

    def __str__(self) -> str:
        return f"{self.of}: {self.number.name} to {self.process}, {self.stage} ({self.at_s:.3f} s)"


NO_VICTIM = "the kill found no process to kill"
"""Failure of a kill that came too late, or whose process was not found."""


class KillError(RuntimeError):
    """A program that did not reach the stage at which it was to be killed."""


@contextmanager
def begun(arguments: list[str], folder: Path) -> "Iterator[subprocess.Popen[bytes]]":
    """Run the program in a folder and kill it at the end of the context.

    Its temporary files are in `tmp`, and its output is in `said`.
    """
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    heeding = ["env", "--default-signal=INT", "--default-signal=HUP"]  # even if the parent ignores them
    environment = {key: value for key, value in os.environ.items() if key != "XDG_RUNTIME_DIR"}
    with (folder / "said").open("ab") as said:
        program = subprocess.Popen(
            [*heeding, str(Path(sys.executable).with_name("vibrohil")), *arguments],
            cwd=folder,
            env={**environment, "TMPDIR": str(temporary)},
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            restore_signals=True,
            start_new_session=True,
        )
    try:
        yield program
    finally:
        program.kill()
        program.wait()


def ended(kill: Kill, program: "subprocess.Popen[bytes]", limit_s: float = END_LIMIT_S) -> int:
    """Wait for the end of the program and return its exit status; a stopped program is killed first."""
    if kill.is_of_program and kill.number == signal.SIGSTOP:
        time.sleep(1.0)
        program.kill()
    return program.wait(limit_s)


def wait_for(look: Callable[[], Any], what: str) -> Any:
    """Wait until `look` returns a true value and return it; raises KillError after START_LIMIT_S."""
    deadline_s = time.monotonic() + START_LIMIT_S
    while not (found := look()):
        if time.monotonic() > deadline_s:
            raise KillError(f"{what} within {START_LIMIT_S:g} s")
        time.sleep(LOOK_S)
    return found


def signalled(pid: int, number: signal.Signals) -> bool:
    """Send the signal; return whether the process still existed."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return False
    return True


def left_over(folder: Path) -> list[str]:
    """Return the processes, sockets and temporary files that still exist GONE_S after the end."""
    deadline_s = time.monotonic() + GONE_S
    while (left := there_now(folder)) and time.monotonic() < deadline_s:
        time.sleep(LOOK_S)
    return left


def there_now(folder: Path) -> list[str]:
    """Return the processes, sockets and temporary files that exist now."""
    place = os.fsencode(folder)
    mine = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # the process has ended meanwhile or belongs to another user
            words = (process / "cmdline").read_bytes()  # empty once a process has ended
            if words and place in words + (process / "environ").read_bytes():
                mine.append(f"process {process.name} {words[:80]!r} is left")
    files = [f"{path} is left" for path in sorted((folder / "tmp").rglob("*"))]
    shared = [f"{path} is left" for path in Path("/dev/shm").glob("vibrohil-*")]
    return mine + files + shared
