"""Kills: every process of a run gets every signal at every stage, and nothing but a verdict is left.

A run is a process of its own with a temporary folder of its own, so that whatever it leaves behind is seen.
The kinds of kills come in an order that the seed shuffles, each at a random moment of its stage.
"""

import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from hil.bench.ending import KILLED
from hil.bench.recorded_run import open_run
from hil.record.log_reader import is_whole
from hil.record.run_traces import read_json

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
low = 0
"""
DURATION_S = 3.0
BENCH = "the bench"
CHILDREN = ("firmware", "plant", "recorder", "hub", "baseline")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, signal.SIGSTOP)
STAGES = {"early": (0.1, 0.5), "middle": (1.0, 2.0), "end": (2.4, 2.8), "report": (0.0, 0.3)}
"""Seconds from the start of the script; of the report, from the end of the run."""
GONE_S = 2.0
START_LIMIT_S = 180.0
END_LIMIT_S = 120.0
LOOK_S = 0.01


class Kill(NamedTuple):
    """What is killed, how and when."""

    clock: str
    process: str
    number: signal.Signals
    stage: str
    at_s: float

    def __str__(self) -> str:
        return f"{self.clock}: {self.number.name} to {self.process}, {self.stage} ({self.at_s:.3f} s)"


class Failure(NamedTuple):
    """A kill and what was wrong after it."""

    kill: Kill
    what: list[str]


class KillError(RuntimeError):
    """A run that did not come to the moment at which it was to be killed."""


def kills(seed: int) -> Iterator[Kill]:
    """Kills without end: all kinds in a random order, then all again."""
    random_numbers = random.Random(seed)
    kinds = [
        ("real", process, number, stage)
        for process, number, stage in itertools.product((BENCH, *CHILDREN), SIGNALS, STAGES)
        if process == BENCH or stage != "report"  # the others have ended by then
    ]
    kinds += [("lockstep", BENCH, number, stage) for number in SIGNALS for stage in STAGES]
    while True:
        random_numbers.shuffle(kinds)
        for clock, process, number, stage in kinds:
            yield Kill(clock, process, number, stage, random_numbers.uniform(*STAGES[stage]))


def wait_for(look: Callable[[], Any], limit_s: float, what: str) -> Any:
    """What `look` finds, once it finds something."""
    deadline_s = time.monotonic() + limit_s
    while not (found := look()):
        if time.monotonic() > deadline_s:
            raise KillError(f"{what} within {limit_s:g} s")
        time.sleep(LOOK_S)
    return found


def await_moment(kill: Kill, run_dir: Path) -> None:
    """Return when it is time to kill."""
    if kill.stage == "report":
        wait_for((run_dir / "outcome.json").exists, START_LIMIT_S, "the run did not end")
        time.sleep(kill.at_s)
        return
    if kill.clock == "lockstep":  # its time is that of its ticks: 100 records of the operator a second
        traced = run_dir / "operator.trace"
        wait_for(traced.exists, START_LIMIT_S, "the run did not begin")
        time.sleep(0.1 * kill.at_s)
        return
    described = run_dir / "run.json"
    t0_ns = wait_for(lambda: read_json(described).get("t0_ns"), START_LIMIT_S, "the run did not begin")
    time.sleep(max(0.0, t0_ns * 1e-9 + kill.at_s - time.monotonic()))


def sent(kill: Kill, bench: "subprocess.Popen[bytes]", run_dir: Path) -> bool:
    """Send the signal; whether the process was still there."""
    pid = bench.pid if kill.process == BENCH else read_json(run_dir / "processes.json")[kill.process]
    try:
        os.kill(pid, kill.number)
    except ProcessLookupError:
        return False
    return True


def left_over(run_dir: Path, temporary: Path) -> list[str]:
    """Processes, sockets and temporary files of a run that is over."""
    places = (os.fsencode(run_dir), os.fsencode(temporary))
    mine = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended meanwhile, or is another user's
            words = (process / "cmdline").read_bytes()  # empty once a process has ended
            if words and any(place in words + (process / "environ").read_bytes() for place in places):
                mine.append(f"process {process.name} {words[:80]!r} is left")
    files = [f"{path} is left" for path in sorted(temporary.rglob("*"))]
    shared = [f"{path} is left" for path in Path("/dev/shm").glob("vibrohil-*")]
    return mine + files + shared


def causes(kill: Kill) -> tuple[str, ...]:
    """Words of which one must be in the verdict's reasons; none where the signal is rightly ignored."""
    if kill.process == BENCH:
        if kill.number in (signal.SIGKILL, signal.SIGSTOP):
            return (KILLED,)
        return (f"interrupted by {'Ctrl-C' if kill.number == signal.SIGINT else kill.number.name}",)
    return () if kill.number == signal.SIGINT else (kill.process,)


def wrong_verdict(kill: Kill, run_dir: Path) -> list[str]:
    """What is wrong with verdict and JUnit."""
    verdict = read_json(run_dir / "verdict.json")
    try:
        ElementTree.parse(run_dir / "junit.xml")
    except (OSError, ElementTree.ParseError) as error:
        return [f"junit.xml: {error}"]
    if not verdict:
        return ["no verdict"]
    said = "; ".join(verdict["reasons"])
    wanted = causes(kill)
    if wanted and not any(word in said for word in wanted):
        # A signal in the last moment of judging may come when the verdict is already written.
        if kill.stage == "report" and verdict["passed"]:
            return []
        return [f"the verdict does not name the cause: {said or 'passed'}"]
    return []


def one_kill(kill: Kill) -> list[str]:
    """Run, kill, and say what is wrong afterwards."""
    with tempfile.TemporaryDirectory(prefix="vibrohil-kills-") as name:
        folder = Path(name)
        run_dir, temporary = folder / "run", folder / "tmp"
        temporary.mkdir()
        (folder / "killed.toml").write_text(SCENARIO)
        program = Path(sys.executable).with_name("vibrohil")
        heeding = ["env", "--default-signal=HUP"]  # under nohup too
        command = [*heeding, str(program), "run", str(folder / "killed.toml"), "--out", str(run_dir)]
        environment = {key: value for key, value in os.environ.items() if key != "XDG_RUNTIME_DIR"}
        bench = subprocess.Popen(
            [*command, "--clock", kill.clock, "--bus", "local"],
            env={**environment, "TMPDIR": str(temporary)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            restore_signals=True,
            start_new_session=True,
        )
        try:
            await_moment(kill, run_dir)
            was_there = bench.poll() is None and sent(kill, bench, run_dir)
            if kill.process == BENCH and kill.number == signal.SIGSTOP:
                time.sleep(1.0)
                bench.kill()
            bench.wait(END_LIMIT_S)
        except (KillError, subprocess.TimeoutExpired) as error:
            return [str(error)]
        finally:
            bench.kill()
            bench.wait()
        deadline_s = time.monotonic() + GONE_S
        while (left := left_over(run_dir, temporary)) and time.monotonic() < deadline_s:
            time.sleep(LOOK_S)
        wrong = list(left)
        if was_there:
            wrong += wrong_verdict(kill, run_dir)
        log = open_run(run_dir).log
        return wrong if is_whole(log) else [*wrong, f"{log.name} does not verify"]


def fuzz_kills(count: int, seed: int, progress: Callable[[int], None]) -> list[Failure]:
    """`count` kills, as many runs at once as there are cores; those after which something was wrong."""
    chosen = list(itertools.islice(kills(seed), count))
    failures = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        futures = {threads.submit(one_kill, kill): kill for kill in chosen}
        for done, future in enumerate(as_completed(futures), 1):
            if wrong := future.result():
                failures.append(Failure(futures[future], wrong))
            progress(done)
    return failures
