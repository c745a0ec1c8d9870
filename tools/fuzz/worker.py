"""A process that runs cases one by one, watched from outside: processor time, memory, remaining files.

Each case has a place of its own with the user's files in it, a folder to run in, and a folder for temporary
files, which must be empty afterwards.
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

from hil.record.run_folder import MADE_BY_A_RUN
from plant_sim.scene import scene_names
from tools.fuzz import file_cases, scene_cases
from tools.fuzz.damage import Random

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

Kind = Literal["scenes", "files"]
Case = Callable[[Random, Path, Path], list[str]]

LONGEST_S = 20.0
"""Of processor time without that of compiling; or without any, asleep for something that does not come."""
MOST_MEMORY_MB = 2048.0
GONE_S = 2.0
LOOK_S = 0.02
IN_ORDER = (0, 1, 4, 5)
"""Exit statuses of a program that knew what to do: passed, a failed check, bad input, nothing to do."""

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
"""By name, with their weights: how often each comes."""


class Attempt(NamedTuple):
    """What came of a case: its name, its command line, the exit status, and what was wrong."""

    case: str
    arguments: tuple[str, ...]
    status: int
    wrong: str


def case_of(kind: Kind, random: Random) -> tuple[str, Case]:
    """One of the cases of a kind, by its name."""
    weights = np.array([weight for weight, _ in CASES[kind].values()])
    name = str(random.choice(list(CASES[kind]), p=weights / weights.sum()))
    return name, CASES[kind][name][1]


# --- in the worker ------------------------------------------------------------------------------------


def attempt(
    kind: Kind, seed: int, good: Path, begun: Callable[[str, tuple[str, ...]], None] = lambda *_: None
) -> Attempt:
    """One case, run in this process; its name and command line go to `begun` before it runs."""
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
            wrong = "" if status in IN_ORDER else said.getvalue()[-2000:] or f"exit status {status}"
        except BaseException as error:  # what is looked for: it is reported, and ends this case
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
    """Inode, size and time of change of everything below a folder but folders; any writing changes one."""
    found = {}
    for path in folder.rglob("*"):
        seen = path.lstat()
        if not stat.S_ISDIR(seen.st_mode):
            found[str(path.relative_to(folder))] = (seen.st_ino, seen.st_size, seen.st_mtime_ns)
    return found


def touched(
    arguments: tuple[str, ...], before: tuple[State, State, State], after: tuple[State, State, State]
) -> str:
    """Which file was touched that is not the command's own, if any.

    In the folder of a run, a log that was cut is mended, or made anew, where it lies; a new run, and pruning,
    take all that a run may write. In the folder in which a command runs it may make new files.
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
    """What is still in the folder for temporary files, and processes that still run, after GONE_S."""
    deadline_s = time.monotonic() + GONE_S
    while (files := list(temporary.rglob("*"))) or running_children(os.getpid()):
        if time.monotonic() > deadline_s:
            names = [str(path.relative_to(temporary)) for path in files]
            return f"left behind: {', '.join(names + running_children(os.getpid()))}"
        time.sleep(LOOK_S)
    return ""


def children_of(pid: int) -> list[int]:
    """The processes that a process has started."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def running_children(pid: int) -> list[str]:
    """Command lines of a process's children; Python's own resource tracker is none of the program's."""
    found = []
    for child in children_of(pid):
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{child}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            ended = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
            if not ended and "resource_tracker" not in words:
                found.append(f"process {words[:200]}")
    return found


class Compiling(Listener):
    """Counts in `depth` how many kernels are being compiled, one within the other."""

    def __init__(self, depth: "Synchronized[int]") -> None:
        self._depth = depth

    def on_start(self, _: object) -> None:
        """One more."""
        self._depth.value += 1

    def on_end(self, _: object) -> None:
        """One less."""
        self._depth.value -= 1


def serve(pipe: Connection, kind: Kind, good: Path, compiling: "Synchronized[int]") -> None:
    """Run cases whose seeds come in, after loading all kernels of the named scenes."""
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


# --- from outside -------------------------------------------------------------------------------------


def processor_s(pid: int) -> float:
    """Processor time of a process, those it has waited for, and those that run; 0 once it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    own_s = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return own_s + sum(processor_s(child) for child in children_of(pid))


def memory_mb(pid: int, peak: bool = False) -> float:
    """Resident memory of a process now, or at its most since `forget_peak`, with that of its children."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    key = "VmHWM:" if peak else "VmRSS:"
    own_mb = sum(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024.0
    return own_mb + sum(memory_mb(child, peak) for child in children_of(pid))


def forget_peak(pid: int) -> None:
    """Let a process's largest memory count from now on."""
    with contextlib.suppress(OSError):
        Path(f"/proc/{pid}/clear_refs").write_text("5")


class Watched(NamedTuple):
    """An attempt with its processor time in s and the largest memory in MB; `alive`: more may be run."""

    attempt: Attempt
    spent_s: float
    largest_mb: float
    alive: bool = True


class Worker:
    """The process, from outside."""

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
        """Of the process."""
        return self._process.pid or 0

    def run(self, seed: int) -> Watched:
        """The case of a seed; a worker that is not alive afterwards is of no more use."""
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
                if self._compiling.value:  # once for a scene of a new kind, and never again
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
        """End the process and what it has started."""
        for child in children_of(self.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, 9)
        self._process.kill()
        self._process.join()
        self._pipe.close()
