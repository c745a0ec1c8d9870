"""Invalid files and options on the command line: random damage, with a seed for each input.

A process runs one command line after another. Each has its own folders: one with the user's files, one to run
in, and one for temporary files, which must be empty afterwards. The program must end by itself with a verdict
or an error message. Failures are: a traceback, more time or memory than `watched` and this module allow, a
change to a file that is not the program's, another program that is started, and a remaining temporary file.
The seed repeats a failure.
"""

import contextlib
import importlib
import math
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from watched import Watch, run_limited

from compilation.kernel_cache import root
from fuzzing import file_cases, scene_cases
from fuzzing.damage import Random
from hil.run_files import MADE_BY_A_RUN

Kind = Literal["scenes", "files"]
Case = Callable[[Random, Path, Path], list[str]]

MOST_BYTES = 1_500_000_000
RENEWED_AFTER = 200
"""Inputs for one process; memory that its libraries keep would otherwise count for later inputs."""
IN_ORDER = (0, 1, 4, 5)
"""Exit statuses of a program that ended properly: passed, a failed check, bad input, nothing ran."""
NO_CASE = ("No such command", "No such option")
"""Errors of a case that calls what the program no longer has: it proves nothing."""
USERS_OWN = ("notes.txt", "scenario.toml", "notes.log", "report.html", "mine.rrd", "mine.toml")
"""The user's files in the folder where commands run; no command may change them."""

CASES: Mapping[Kind, Mapping[str, tuple[float, Case]]] = {
    "scenes": {
        "scene, tables": (4.0, scene_cases.scene_tables),
        "scene, bytes": (1.5, scene_cases.scene_bytes),
        "scene, --set": (2.0, scene_cases.scene_setting),
        "scenario, tables": (2.0, scene_cases.scenario_tables),
        "scenario, bytes": (1.0, scene_cases.scenario_bytes),
        "scenario, --set": (1.5, scene_cases.run_setting),
        "parameter file": (1.5, scene_cases.parameter_file),
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
    """Result of a case: its seed, name and command line, the exit status, and the failure (empty if none).

    `took_s` and `most_bytes` are its computing time and its peak of memory.
    """

    seed: int
    case: str
    arguments: tuple[str, ...]
    status: int
    wrong: str
    took_s: float = math.inf
    most_bytes: int = 0


def case_of(kind: Kind, random: Random) -> tuple[str, Case]:
    """Choose one of the cases of a kind; return its name and the case."""
    weights = np.array([weight for weight, _ in CASES[kind].values()])
    name = str(random.choice(list(CASES[kind]), p=weights / weights.sum()))
    return name, CASES[kind][name][1]


def attempt(
    kind: Kind,
    seed: int,
    good: Path,
    watch: Watch,
    begun: Callable[[str, tuple[str, ...]], None] = lambda *_: None,
) -> Attempt:
    """Run one case in this process; `begun` is called with its name and command line before it runs."""
    random = np.random.default_rng(seed)
    name, case = case_of(kind, random)
    with tempfile.TemporaryDirectory(dir=good.parent) as place:
        mine, work, temporary = (Path(place) / part for part in ("mine", "work", "tmp"))
        for folder in (mine, work, temporary):
            folder.mkdir()
        arguments = tuple(case(random, mine, good))
        for users in USERS_OWN:
            (work / users).write_text("not to be touched")
        begun(name, arguments)
        before = state_of(good), state_of(mine), state_of(work)
        os.chdir(work)
        tempfile.tempdir = os.environ["TMPDIR"] = str(temporary)
        watch.folder, watch.harm = f"{os.path.realpath(place)}/", []
        try:
            ran = run_limited(arguments)
        finally:
            watch.folder = f"{os.path.realpath(good.parent)}/"
            tempfile.tempdir = None
            del os.environ["TMPDIR"]
            os.chdir(good)
        after = state_of(good), state_of(mine), state_of(work)
        left = ", ".join(path.name for path in temporary.rglob("*"))
    wrong = ""
    if ran["status"] not in IN_ORDER or any(words in ran["error"] for words in NO_CASE):
        wrong = ran["error"] or f"exit status {ran['status']}"
    elif ran["most_bytes"] > MOST_BYTES:
        wrong = f"it took {ran['most_bytes'] >> 20} MB"
    elif left:
        wrong = f"left behind: {left}"
    wrong = wrong or touched(arguments, before, after) or "; ".join(watch.harm)
    return Attempt(seed, name, arguments, ran["status"], wrong, ran["took_s"], ran["most_bytes"])


def worst_by_format(attempts: Iterable[Attempt]) -> list[str]:
    """For each kind of file, and each ending of a log: inputs, longest time and largest memory, as a line."""
    found: dict[str, list[Attempt]] = {}
    for one in attempts:
        log = next((Path(word).name for word in one.arguments if "/bench." in word), "")
        found.setdefault(f"{one.case} {log}".strip(), []).append(one)
    return [
        f"{name}: {len(all_)} inputs, at most {max(one.took_s for one in all_):.1f} s of computing time and "
        f"{max(one.most_bytes for one in all_) / 1e9:.2f} GB"
        for name, all_ in sorted(found.items())
    ]


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


def serve(pipe: Connection, kind: Kind, seeds: Iterable[int], good: Path) -> None:
    """Run the cases with these seeds; send name and command line of each before it runs, then the attempt."""
    importlib.import_module("matplotlib.font_manager")  # makes its folders at the first time
    os.environ.pop("DISPLAY", None)
    os.environ.pop("WAYLAND_DISPLAY", None)
    os.chdir(good)
    watch = Watch([str(root())])
    watch.folder = f"{os.path.realpath(good.parent)}/"
    sys.addaudithook(watch)
    with contextlib.suppress(BrokenPipeError):
        for seed in seeds:
            pipe.send(attempt(kind, seed, good, watch, lambda *begun: pipe.send(begun)))


def attempts(kind: Kind, seeds: Sequence[int], good: Path) -> Iterator[Attempt]:
    """Run the cases with these seeds, each in the process of the one before unless that has ended."""
    context = get_context("spawn")
    while seeds:
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=serve, args=(theirs, kind, seeds[:RENEWED_AFTER], good))
        process.start()
        theirs.close()
        case, arguments = "none", ()
        try:
            for _ in seeds[:RENEWED_AFTER]:
                case, arguments = ours.recv()
                yield ours.recv()
                seeds = seeds[1:]
        except EOFError:
            process.join()
            died = f"the process died (exit code {process.exitcode})"
            yield Attempt(seeds[0], case, arguments, -1, died)
            seeds = seeds[1:]
        finally:
            process.kill()
            process.join()
            ours.close()


def fuzz(kind: Kind, count: int, seed: int) -> list[Attempt]:
    """Run as many cases, with seeds from `seed` on."""
    with tempfile.TemporaryDirectory(prefix="vibrohil-fuzz-") as place:
        good = Path(place) / "good"
        good.mkdir()
        file_cases.prepare(good)
        return list(attempts(kind, range(seed, seed + count), good))
