"""Kills: every process of a run, a suite and a campaign receives every signal at every stage.

Each kill has its own program and its own temporary folder, so that all remaining files and processes are
found. The kinds of kills have a random order that depends on the seed; each kill is at a random time of its
stage.
"""

import itertools
import os
import random
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from fuzzing import queue_kills, run_kills
from fuzzing.kill import PARENT, REPORT, SIGNALS, Kill

QUEUES = ("suite", "campaign")


class Failure(NamedTuple):
    """A kill and the failures after it."""

    kill: Kill
    what: list[str]


def kinds() -> list[tuple[str, str, signal.Signals, str]]:
    """Return all combinations of program, process, signal and stage.

    At REPORT only the program itself still runs.
    """
    processes = {
        "real": (PARENT, *run_kills.CHILDREN),
        "lockstep": (PARENT,),
        **dict.fromkeys(QUEUES, (PARENT, queue_kills.WORKER)),
    }
    return [
        (of, process, number, stage)
        for of, some in processes.items()
        for process, number, stage in itertools.product(some, SIGNALS, run_kills.STAGES)
        if process == PARENT or stage != REPORT
    ]


def kills(seed: int) -> Iterator[Kill]:
    """Yield kills endlessly: all kinds in a random order, then all kinds again in another order."""
    random_numbers = random.Random(seed)
    shuffled = kinds()
    while True:
        random_numbers.shuffle(shuffled)
        for of, process, number, stage in shuffled:
            if (of, stage) == ("campaign", REPORT):  # it writes no report
                continue
            stages = queue_kills.STAGES if of in QUEUES else run_kills.STAGES
            yield Kill(of, process, number, stage, random_numbers.uniform(*stages[stage]))


def one_kill(kill: Kill) -> list[str]:
    """Run a program, kill it, and return the failures."""
    return queue_kills.killed_queue(kill) if kill.of in QUEUES else run_kills.killed_run(kill)


def fuzz_kills(count: int, seed: int) -> list[Failure]:
    """Run `count` kills, as many at once as there are cores, and return the failures."""
    chosen = list(itertools.islice(kills(seed), count))
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        try:
            outcomes = list(threads.map(one_kill, chosen))
        finally:
            threads.shutdown(cancel_futures=True)  # an interruption begins no further kill
    return [Failure(kill, wrong) for kill, wrong in zip(chosen, outcomes, strict=True) if wrong]
