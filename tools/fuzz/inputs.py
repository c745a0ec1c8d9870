"""Files and options that nobody should give, at the command line: damaged at random, each by its own seed.

A worker process runs one command line after another in folders of its own; the program must end by itself
with a verdict or a sentence. A traceback, more than LONGEST_S of processor time or MOST_MEMORY_MB, or a
change to a file beside its own is a failure; its seed repeats it.
"""

import contextlib
import hashlib
import io
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal, NamedTuple

import can
import numpy as np
import tomli_w

from hil.bench.soak import own_memory_mb
from hil.record.candump import parse_candump
from plant_sim.scene import read_scene, scene_names

Kind = Literal["scenes", "files"]
Random = np.random.Generator

LONGEST_S = 20.0
LONGEST_WALL_S = 300.0
"""On a busy machine; in it, LONGEST_S of processor time fit easily."""
MOST_MEMORY_MB = 2048.0
ENOUGH_FAILURES = 10
IN_ORDER = (0, 1, 4, 5)
"""Exit statuses of a program that knew what to do: passed, a failed check, bad input, nothing to do."""

SCENARIO = """
title = "A short start"
scene = "table1-motor-soft"
[script]
duration_s = 0.3
[[script.commands]]
at_s = 0.1
request = "run"
target_ratio = 1.1
[[checks]]
name = "fault"
equals = "none"
"""
PARAMETERS = """
format = 1
[parameters."speed.gain_p_n_m_s"]
value = 0.02
unit = "N m s"
"""
NASTY: tuple[Any, ...] = (
    *(1e308, -1e308, 1e-308, 5e-324, math.nan, math.inf, -math.inf, 0, -1, 0.0, -0.0, 1e16, 1e-16, 3.5),
    *(10**18, -(2**63), True, "", "x" * 5000, "\u0000", "nan", [], [[]], {}, {"a": {"b": 1}}, [1, "x"]),
)
RAW_VALUES = (
    "9" * 400,
    "9" * 5000,
    "0x" + "f" * 4000,
    "[" * 5000,
    "{a=" * 2000,
    "1e400",
    "'",
    "2026-01-01",
    "",
)


class Failure(NamedTuple):
    """What went wrong in the case of a seed, and with which command line."""

    seed: int
    what: str
    arguments: tuple[str, ...]


class Outcome(NamedTuple):
    """How many inputs came to which exit status, the slowest and the largest, and all failures."""

    kind: str
    inputs: int
    statuses: dict[int, int]
    slowest_s: float
    largest_mb: float
    failures: tuple[Failure, ...]


# --- damage -------------------------------------------------------------------------------------------


def damaged_bytes(random: Random, content: bytes) -> bytes:
    """Bits turned over, a piece cut out or replaced, the end cut off, or other content altogether."""
    size = len(content)
    first, last = sorted(int(place) for place in random.integers(0, size + 1, 2))
    before, within, after = content[:first], content[first:last], content[last:]
    damaged = (
        before,
        before + after,
        before + 2 * within + after,
        before + random.bytes(last - first) + after,
    )
    choice = int(random.integers(0, 8))
    if choice < len(damaged):
        return damaged[choice]
    if choice == len(damaged) or not content:
        return random.bytes(int(random.integers(0, 1000)))
    turned = bytearray(content)
    head = min(size, 300) if random.random() < 0.5 else size
    for place in random.integers(0, head, int(random.integers(1, 20))).tolist():
        turned[place] ^= 1 << int(random.integers(0, 8))
    return bytes(turned)


def damaged_tables(random: Random, tables: dict[str, Any]) -> dict[str, Any]:
    """One to three values of the tables, at any depth, replaced, renamed or taken out."""
    for _ in range(int(random.integers(1, 4))):
        table, path = tables, []
        while True:
            key = str(random.choice(sorted(table)))
            path.append(key)
            inner = table[key]
            if not isinstance(inner, dict) or not inner or random.random() < 0.1:
                break
            table = inner
        match int(random.integers(0, 6)):
            case 0 if not isinstance(table[key], dict):
                del table[key]
            case 1:
                table[key + "x"] = table.pop(key)
            case _ if key not in ("law", "model", "method"):  # another law would be compiled, not refused
                table[key] = NASTY[int(random.integers(0, len(NASTY)))]
        if not table:
            break
    return tables


# --- cases: each writes its files to `mine` and gives a command line ----------------------------------


def scene_case(random: Random, mine: Path, _: Path) -> list[str]:
    """A scene, scenario, parameter file or setting, damaged."""
    path = mine / "mine.toml"
    name = str(random.choice(scene_names()))
    choice = random.random()
    if choice < 0.5:
        path.write_text(tomli_w.dumps(damaged_tables(random, read_scene(name))), encoding="utf-8")
        return ["simulate", str(path), "--until", "0.2"]
    if choice < 0.6:
        text = tomli_w.dumps(read_scene(name)).encode()
        path.write_bytes(damaged_bytes(random, text))
        return ["simulate", str(path), "--until", "0.2"]
    if choice < 0.8:
        return ["simulate", name, "--until", "0.2", "--set", setting(random, name)]
    if choice < 0.9:
        path.write_bytes(damaged_bytes(random, PARAMETERS.encode()))
        return ["tune", "diff", str(path), str(path), "--no-suite"]
    path.write_bytes(damaged_bytes(random, SCENARIO.encode()))
    return ["run", str(path), "--clock", "lockstep", "--out", "run"]


def setting(random: Random, name: str) -> str:
    """A change of one value of a scene, of which little makes sense."""
    keys, table = ["scene"], read_scene(name)
    while isinstance(table, dict) and table:
        keys.append(str(random.choice(sorted(table))))
        table = table[keys[-1]]
    if random.random() < 0.2 or keys[-1] in ("law", "model", "method"):
        keys[-1] = str(random.choice(["", "x" * 3000, "a.b.c.d.e.f.g.h.i", "law"]))
        return ".".join(keys) + "=x"
    if random.random() < 0.5:
        return f"{'.'.join(keys)}={random.choice(RAW_VALUES)}"
    return f"{'.'.join(keys)}={NASTY[int(random.integers(0, len(NASTY)))]}"


def file_case(random: Random, mine: Path, whole: Path) -> list[str]:
    """A run's folder or a CAN log, damaged, and a command that reads it."""
    run = mine / "run"
    if random.random() < 0.4:
        log = mine / str(random.choice([path.name for path in sorted(whole.glob("bench.*"))]))
        log.write_bytes(damaged_bytes(random, (whole / log.name).read_bytes()))
        return ["import", str(log), "--out", "imported"]
    shutil.copytree(whole / "run", run)
    names = sorted(path.name for path in run.iterdir() if path.is_file())
    for name in random.choice(names, int(random.integers(1, 3)), replace=False).tolist():
        path = run / name
        if random.random() < 0.1:
            path.unlink()
        else:
            path.write_bytes(damaged_bytes(random, path.read_bytes()))
    if random.random() < 0.3:
        (run / "run.rrd").unlink(missing_ok=True)
    commands = (
        ["inspect", str(run), "--json"],
        ["inspect", str(run / "run.rrd")],
        ["inspect", str(run), "--table", "plant"],
        ["inspect", str(run), "--plot", "signals.svg"],
        ["compare", str(run), str(whole / "run")],
        ["import", str(run / "can.log"), "--out", "imported"],
    )
    return commands[int(random.integers(0, len(commands)))]


CASES: Mapping[Kind, Callable[[Random, Path, Path], list[str]]] = {"scenes": scene_case, "files": file_case}


def prepare(whole: Path) -> None:
    """A good run's folder, and its CAN log in every format that `import` reads."""
    from tools.cli import run

    (whole / "short.toml").write_text(SCENARIO)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        run(
            [
                "run",
                str(whole / "short.toml"),
                "--clock",
                "lockstep",
                "--keep-traces",
                "--out",
                str(whole / "run"),
            ]
        )
    bus = parse_candump((whole / "run" / "can.log").read_bytes())
    for ending in ("log", "asc", "blf", "csv", "trc", "log.gz"):
        with can.Logger(whole / f"bench.{ending}") as logger:
            for t_s, can_id, payload in zip(bus.t_s.tolist(), bus.can_id.tolist(), bus.payloads, strict=True):
                logger(
                    can.Message(
                        timestamp=t_s + 1e9,
                        arbitration_id=can_id,
                        data=payload,
                        is_extended_id=False,
                        channel=0,
                    )
                )


# --- a worker -----------------------------------------------------------------------------------------


def digest(folder: Path) -> str:
    """Of all names and contents below a folder."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        found.update(str(path.relative_to(folder)).encode())
        if path.is_file():
            found.update(path.read_bytes())
    return found.hexdigest()


def attempt(kind: Kind, seed: int, whole: Path) -> tuple[tuple[str, ...], int, str]:
    """One case, run in this process: its command line, its exit status, and what was wrong."""
    from tools.cli import run

    with tempfile.TemporaryDirectory(prefix="vibrohil-fuzz-") as place:
        mine, work = Path(place) / "mine", Path(place) / "work"
        for folder in (mine, work):
            folder.mkdir()
        (mine / "notes.txt").write_text("not to be touched")
        arguments = CASES[kind](np.random.default_rng(seed), mine, whole)
        own_log = mine / "run"  # a log that was cut is mended where it lies
        before = digest(whole), (mine / "notes.txt").read_bytes(), None if own_log.exists() else digest(mine)
        said = io.StringIO()
        os.chdir(work)
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                status = run(arguments)
            wrong = "" if status in IN_ORDER else said.getvalue()[-2000:] or f"exit status {status}"
        except BaseException as error:  # what is looked for: it is reported, and ends this case
            if isinstance(error, KeyboardInterrupt):
                raise
            status, wrong = -1, f"{type(error).__name__}: {error}"[:2000]
        finally:
            os.chdir(whole)
        after = digest(whole), (mine / "notes.txt").read_bytes(), None if own_log.exists() else digest(mine)
        if not wrong and before != after:
            wrong = "a file beside its own was changed"
    return tuple(arguments), status, wrong


def serve(pipe: Connection, kind: Kind, whole: Path) -> None:
    """Run cases whose seeds come in, after loading all kernels of the named scenes."""
    from tools.cli import run

    os.environ.pop("DISPLAY", None)
    os.chdir(whole)
    if kind == "scenes":
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            for name in scene_names():
                run(["simulate", name, "--until", "0.01"])
    pipe.send(None)
    while True:
        pipe.send(attempt(kind, pipe.recv(), whole))


def processor_s(pid: int) -> float:
    """Processor time that a process and those it has waited for have taken; 0 once it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def children_of(pid: int) -> list[int]:
    """The processes that a process has started."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


class Worker:
    """A process that runs cases, watched from outside."""

    def __init__(self, kind: Kind, whole: Path) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, kind, whole), daemon=True)
        self._process.start()
        theirs.close()
        self._pipe.recv()

    def run(self, seed: int) -> tuple[tuple[str, ...], int, str, float, float]:
        """As `attempt`, with processor time in s and the largest memory in MB."""
        pid = self._process.pid or 0
        began_s, started_s = processor_s(pid), time.monotonic()
        largest_mb = 0.0
        self._pipe.send(seed)
        while not self._pipe.poll(0.02):
            spent_s = processor_s(pid) - began_s
            largest_mb = max(largest_mb, own_memory_mb(pid) or 0.0)
            if not self._process.is_alive():
                return (), -1, f"the process died (exit code {self._process.exitcode})", spent_s, largest_mb
            if largest_mb > MOST_MEMORY_MB:
                return (), -1, f"it took {largest_mb:.0f} MB", spent_s, largest_mb
            if spent_s > LONGEST_S or time.monotonic() - started_s > LONGEST_WALL_S:
                return (), -1, f"it did not end within {LONGEST_S:g} s", spent_s, largest_mb
        try:
            arguments, status, wrong = self._pipe.recv()
        except EOFError:
            return (), -1, f"the process died (exit code {self._process.exitcode})", 0.0, largest_mb
        return (
            arguments,
            status,
            wrong,
            processor_s(pid) - began_s,
            max(largest_mb, own_memory_mb(pid) or 0.0),
        )

    def close(self) -> None:
        """End the process and what it has started."""
        for child in children_of(self._process.pid or 0):
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, 9)
        self._process.kill()
        self._process.join()
        self._pipe.close()


def fuzz(kind: Kind, inputs: int, seed: int, progress: Callable[[int], None] = lambda _: None) -> Outcome:
    """Cases of the seeds from `seed` on, until there were `inputs`, or enough have failed."""
    statuses: dict[int, int] = {}
    failures: list[Failure] = []
    slowest_s = largest_mb = 0.0
    done = 0
    with tempfile.TemporaryDirectory(prefix="vibrohil-fuzz-") as place:
        whole = Path(place)
        if kind == "files":
            prepare(whole)
        worker = Worker(kind, whole)
        try:
            while done < inputs and len(failures) < ENOUGH_FAILURES:
                arguments, status, wrong, spent_s, used_mb = worker.run(seed + done)
                statuses[status] = statuses.get(status, 0) + 1
                slowest_s, largest_mb = max(slowest_s, spent_s), max(largest_mb, used_mb)
                if wrong:
                    failures.append(Failure(seed + done, wrong, arguments))
                if not arguments:
                    worker.close()
                    worker = Worker(kind, whole)
                done += 1
                progress(done)
        finally:
            worker.close()
    return Outcome(kind, done, statuses, slowest_s, largest_mb, tuple(failures))
