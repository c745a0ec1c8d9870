"""A worker process that runs cases one by one, and its monitor: processor time, memory, remaining files.

Each case has its own folders: one with the user's files, one to run in, and one for temporary files, which
must be empty afterwards.
"""

import contextlib
import io
import os
import stat
import tempfile
import time
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numba.core.event import Listener, register

from fuzzing import file_cases, scene_cases
from fuzzing.damage import Random
from hil.record.run_folder import MADE_BY_A_RUN
from plant_sim.scene import scene_names

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

Kind = Literal["scenes", "files"]
Case = Callable[[Random, Path, Path], list[str]]

LONGEST_S = 20.0
"""Limit of a case's processor time without compilation, and of its time without progress, s."""
MOST_MEMORY_MB = 2048.0
GONE_S = 2.0
LOOK_S = 0.02
IN_ORDER = (0, 1, 4, 5)
"""Exit statuses of a program that ended properly: passed, a failed check, bad input, nothing ran."""

CASES: Mapping[Kind, Mapping[str, tuple[float, Case]]] = {
    "scenes": {
        "scene, tables": (4.0, scene_cases.scene_tables),
        "scene, bytes": (1.5, scene_cases.scene_bytes),
        "scene, --set": (2.0, scene_cases.scene_setting),
        "scenario, tables": (2.0, scene_cases.scenario_tables),
        "scenario, bytes": (1.0, scene_cases.scenario_bytes),
        "scenario, --set": (1.5, scene_cases.run_setting),
        "parameter file": (1.5, scene_cases.parameter_file),
        "special file": (1.0, scene_cases.special_file),
        "place to write to": (0.5, scene_cases.output_place),
    },
    "files": {
        "CAN log": (4.0, file_cases.can_log),
        ".rrd file": (2.0, file_cases.recording),
        "traces": (2.0, file_cases.traces),
        "run folder": (2.0, file_cases.run_folder),
        "suite folder": (0.5, file_cases.suite_folder),
    },
}
"""Cases by name, each with its relative frequency."""


class Attempt(NamedTuple):
    """Result of a case: its name, its command line, the exit status, and the failure (empty if none)."""

    case: str
    arguments: tuple[str, ...]
    status: int
    wrong: str


def case_of(kind: Kind, random: Random) -> tuple[str, Case]:
    """Choose one of the cases of a kind; return its name and the case."""
    weights = np.array([weight for weight, _ in CASES[kind].values()])
    name = str(random.choice(list(CASES[kind]), p=weights / weights.sum()))
    return name, CASES[kind][name][1]


# --- in the worker ------------------------------------------------------------------------------------


NO_CASE = ("No such command", "No such option")
"""Errors of a case that calls what the program no longer has: it proves nothing."""


def attempt(
    kind: Kind, seed: int, good: Path, begun: Callable[[str, tuple[str, ...]], None] = lambda *_: None
) -> Attempt:
    """Run one case in this process; `begun` is called with its name and command line before it runs."""
    from tools.cli import run

    random = np.random.default_rng(seed)
    name, case = case_of(kind, random)
    with tempfile.TemporaryDirectory(dir=good.parent) as place:
        mine, work, temporary = (Path(place) / part for part in ("mine", "work", "tmp"))
        for folder in (mine, work, temporary):
            folder.mkdir()
        arguments = tuple(case(random, mine, good))
        for users in scene_cases.USERS_OWN:
            (work / users).write_text("not to be touched")
        begun(name, arguments)
        before = state_of(good), state_of(mine), state_of(work)
        said = io.StringIO()
        os.chdir(work)
        tempfile.tempdir = os.environ["TMPDIR"] = str(temporary)
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                status = run(list(arguments))
            is_wrong = status not in IN_ORDER or any(words in said.getvalue() for words in NO_CASE)
            wrong = (said.getvalue()[-2000:] or f"exit status {status}") if is_wrong else ""
        except BaseException as error:  # any error is a failure: it is reported and ends this case
            if isinstance(error, KeyboardInterrupt):
                raise
            status, wrong = -1, f"{type(error).__name__}: {error}"[:2000]
        finally:
            tempfile.tempdir = None
            del os.environ["TMPDIR"]
            os.chdir(good)
        after = state_of(good), state_of(mine), state_of(work)
        if not wrong:
            wrong = touched(arguments, before, after) or left(temporary)
    return Attempt(name, arguments, status, wrong)


State = Mapping[str, tuple[int, int, int]]


def state_of(folder: Path) -> State:
    """Return inode, size and modification time of all files below a folder; any write changes one of them."""
    found = {}
    for path in folder.rglob("*"):
        seen = path.lstat()
        if not stat.S_ISDIR(seen.st_mode):
            found[str(path.relative_to(folder))] = (seen.st_ino, seen.st_size, seen.st_mtime_ns)
    return found


def touched(
    arguments: tuple[str, ...], before: tuple[State, State, State], after: tuple[State, State, State]
) -> str:
    """Return, as text, which files were changed that do not belong to the command; empty if none.

    In a run's folder a command may repair or rebuild the log; a new run, and pruning, may change all files
    that a run writes. In the folder in which a command runs it may make new files.
    """
    runs_there = arguments[0] in ("run", "runs")
    own = {f"run/{name}" for name in (MADE_BY_A_RUN if runs_there else ("run.rrd",))}
    own |= {"run.rrd"}
    for was, now, free in zip(before, after, ((), own, ()), strict=True):
        changed = [name for name in was if now.get(name) != was[name] and name not in free]
        if changed:
            return f"files beside its own were changed: {', '.join(changed)}"
    new = [name for name in after[1] if name not in before[1] and name not in own]
    return f"files were left among the user's: {', '.join(new)}" if new else ""


def left(temporary: Path) -> str:
    """Return, as text, the temporary files and processes that remain after GONE_S; empty if none."""
    deadline_s = time.monotonic() + GONE_S
    while (files := list(temporary.rglob("*"))) or running_children(os.getpid()):
        if time.monotonic() > deadline_s:
            names = [str(path.relative_to(temporary)) for path in files]
            return f"left behind: {', '.join(names + running_children(os.getpid()))}"
        time.sleep(LOOK_S)
    return ""


def children_of(pid: int) -> list[int]:
    """Return the ids of a process's children."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def running_children(pid: int) -> list[str]:
    """Return the command lines of a process's running children, without Python's resource tracker."""
    found = []
    for child in children_of(pid):
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{child}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            ended = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
            if not ended and "resource_tracker" not in words:
                found.append(f"process {words[:200]}")
    return found


class Compiling(Listener):
    """Listener that counts in `depth` the nested compilations of kernels in progress."""

    def __init__(self, depth: "Synchronized[int]") -> None:
        self._depth = depth

    def on_start(self, _: object) -> None:
        """Count one compilation more."""
        self._depth.value += 1

    def on_end(self, _: object) -> None:
        """Count one compilation less."""
        self._depth.value -= 1


def serve(pipe: Connection, kind: Kind, good: Path, compiling: "Synchronized[int]") -> None:
    """Load the kernels of all named scenes, then run the cases whose seeds arrive on the pipe."""
    from tools.cli import run

    register("numba:compile", Compiling(compiling))  # type: ignore[no-untyped-call]  # numba has no types
    os.environ.pop("DISPLAY", None)
    os.environ.pop("WAYLAND_DISPLAY", None)
    os.chdir(good)
    if kind == "scenes":
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            for name in scene_names():
                run(["simulate", name, "--until", "0.01"])
    pipe.send(None)
    while True:
        pipe.send(attempt(kind, pipe.recv(), good, lambda *begun: pipe.send(begun)))


# --- in the monitor -----------------------------------------------------------------------------------


def processor_s(pid: int) -> float:
    """Return the processor time of a process and its children, ended or running, s; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    own_s = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return own_s + sum(processor_s(child) for child in children_of(pid))


def memory_mb(pid: int, peak: bool = False) -> float:
    """Return the resident memory of a process and its children, MB: now, or the peak since `forget_peak`."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    key = "VmHWM:" if peak else "VmRSS:"
    own_mb = sum(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024.0
    return own_mb + sum(memory_mb(child, peak) for child in children_of(pid))


def forget_peak(pid: int) -> None:
    """Reset the peak of a process's memory."""
    with contextlib.suppress(OSError):
        Path(f"/proc/{pid}/clear_refs").write_text("5")


class Watched(NamedTuple):
    """An attempt with its processor time, s, and peak memory, MB; `alive`: the worker can run more cases."""

    attempt: Attempt
    spent_s: float
    largest_mb: float
    alive: bool = True


class Worker:
    """The worker process, seen from the monitor."""

    def __init__(self, kind: Kind, good: Path) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._compiling = context.Value("i", 0)
        self._process = context.Process(target=serve, args=(theirs, kind, good, self._compiling))
        self._process.start()
        theirs.close()
        self._pipe.recv()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid or 0

    def run(self, seed: int) -> Watched:
        """Run the case with this seed; if the result is not `alive`, the worker must be replaced."""
        pid = self.pid
        forget_peak(pid)
        began_s = last_s = processor_s(pid)
        moved_s = time.monotonic()
        largest_mb = 0.0
        self._pipe.send(seed)
        name, arguments = self._pipe.recv()
        while not self._pipe.poll(LOOK_S):
            now_s, largest_mb = processor_s(pid), max(largest_mb, memory_mb(pid))
            if now_s > last_s:
                if self._compiling.value:  # only at the first scene of a new kind
                    began_s += now_s - last_s
                last_s, moved_s = now_s, time.monotonic()
            wrong = ""
            if not self._process.is_alive():
                wrong = f"the process died (exit code {self._process.exitcode})"
            elif largest_mb > MOST_MEMORY_MB:
                wrong = f"it took {largest_mb:.0f} MB"
            elif now_s - began_s > LONGEST_S:
                wrong = f"it did not end within {LONGEST_S:g} s of processor time"
            elif time.monotonic() - moved_s > LONGEST_S:
                wrong = f"it waited for {LONGEST_S:g} s without end"
            if wrong:
                return Watched(Attempt(name, arguments, -1, wrong), last_s - began_s, largest_mb, alive=False)
        largest_mb = max(largest_mb, memory_mb(pid, peak=True))
        try:
            found: Attempt = self._pipe.recv()
        except EOFError:
            lost = Attempt(name, arguments, -1, f"the process died (exit code {self._process.exitcode})")
            return Watched(lost, last_s - began_s, largest_mb, alive=False)
        if largest_mb > MOST_MEMORY_MB and not found.wrong:
            found = found._replace(wrong=f"it took {largest_mb:.0f} MB")
        return Watched(found, processor_s(pid) - began_s, largest_mb)

    def close(self) -> None:
        """End the process and its children."""
        for child in children_of(self.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, 9)
        self._process.kill()
        self._process.join()
        self._pipe.close()
