"""Kills: every process of a run, a suite and a campaign receives every signal at every stage.

Each kill has its own program and its own temporary folder, so that all remaining files and processes are
found. The kinds of kills have a random order that depends on the seed; each kill is at a random time of its
stage.
"""

import itertools
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from fuzzing import kill as killing
from fuzzing import queue_kills, run_kills
from fuzzing.kill import PARENT, REPORT, SIGNALS, Kill

from hil.processes.workers import Workers
from tools.study import work

QUEUES = ("suite", "campaign")
PROCESSES = {
    "lockstep": (PARENT,),
    **dict.fromkeys(QUEUES, (PARENT, queue_kills.WORKER)),
    "real": (PARENT, *run_kills.CHILDREN),
}
"""Processes that a signal is sent to, by the program."""
KINDS = [
    (of, process, number, stage)
    for of, some in PROCESSES.items()
    for process, number, stage in itertools.product(some, SIGNALS, run_kills.STAGES)
    if stage != REPORT or (process == PARENT and of != "campaign")
]
"""At REPORT only the program itself still runs; a campaign writes no report."""


def kills(seed: int) -> Iterator[Kill]:
    """Yield kills endlessly: all kinds in a random order, then all kinds again in another order."""
    random_numbers = random.Random(seed)
    while True:
        for of, process, number, stage in random_numbers.sample(KINDS, len(KINDS)):
            stages = queue_kills.STAGES if of in QUEUES else run_kills.STAGES
            yield Kill(of, process, number, stage, random_numbers.uniform(*stages[stage]))


def one_kill(kill: Kill) -> list[str]:
    """Run a program, kill it, and return the failures."""
    return queue_kills.killed_queue(kill) if kill.of in QUEUES else run_kills.killed_run(kill)


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("process", "number"),
    [
        ("hub", signal.SIGTERM),  # in order: no hold of the host
        ("recorder", signal.SIGKILL),
        ("recorder", signal.SIGSTOP),
        (PARENT, signal.SIGINT),
        (PARENT, signal.SIGKILL),
    ],
)
def test_a_run_whose_process_dies_says_so_and_leaves_nothing(process: str, number: signal.Signals) -> None:
    assert one_kill(Kill("real", process, number, "middle", 1.0)) == []


@pytest.mark.realtime
def test_kills_leave_nothing_but_a_verdict(pytestconfig: pytest.Config) -> None:
    """As many at once as there are cores; the first two are of a campaign's worker and a suite's program."""
    count = pytestconfig.getoption("fuzz_count") or 2
    chosen = list(itertools.islice(kills(pytestconfig.getoption("fuzz_seed")), count))
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        outcomes = zip(chosen, threads.map(one_kill, chosen), strict=True)
        assert {str(kill): wrong for kill, wrong in outcomes if wrong} == {}


def idle(_: int) -> int:
    return os.getpid()


def test_kills_find_the_workers_of_a_suite_and_a_campaign_as_they_are_started() -> None:
    with Workers(idle, 1) as some:
        pid = dict(some.results([1]))[1]
        assert queue_kills.worker_of(SimpleNamespace(pid=os.getpid())) == pid
    assert queue_kills.worker_of(SimpleNamespace(pid=os.getpid())) == 0


def test_the_trials_of_a_campaign_that_have_ended_are_counted(tmp_path: Path) -> None:
    queue = queue_kills.Queue("campaign", tmp_path)
    assert queue.finished() == {}
    for path in work.paths_of("batch", [1, 2], tmp_path / "runs" / "campaign-start-up"):
        work.store(path, 1, [])
    assert len(queue.finished()) == 2


@pytest.mark.parametrize("of", QUEUES)
def test_a_kill_without_a_victim_is_a_failure(of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def already_over(arguments: list[str], folder: Path) -> Iterator["subprocess.Popen[bytes]"]:
        (folder / "tmp").mkdir()
        (folder / "said").write_text("")
        program = subprocess.Popen([sys.executable, "-c", ""])
        program.wait()
        yield program

    monkeypatch.setattr(killing, "begun", already_over)
    kill = Kill(of, queue_kills.WORKER, signal.SIGKILL, "middle", 0.0)
    assert killing.NO_VICTIM in queue_kills.killed_queue(kill)
