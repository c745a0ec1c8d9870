"""Invalid files and options on the command line: random damage, with a seed for each input.

A worker process runs one command line after another. The program must end by itself with a verdict or an
error message. Failures are: a traceback, more than LONGEST_S of processor time or of waiting, more than
MOST_MEMORY_MB, a change to a file that is not the program's, and a remaining temporary file or process. The
seed repeats a failure.
"""

import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from fuzzing.file_cases import prepare
from fuzzing.worker import Kind, Worker

ENOUGH_FAILURES = 10
RENEWED_AFTER = 200
"""Inputs for one worker; memory that its libraries keep would otherwise count for later inputs."""


class Failure(NamedTuple):
    """A failure of the case with this seed, and its command line."""

    seed: int
    case: str
    what: str
    arguments: tuple[str, ...]


class Outcome(NamedTuple):
    """Numbers of inputs by case and by exit status, the largest time and memory, and all failures."""

    kind: str
    inputs: int
    cases: dict[str, int]
    statuses: dict[int, int]
    slowest_s: float
    largest_mb: float
    failures: tuple[Failure, ...]


def fuzz(kind: Kind, inputs: int, seed: int) -> Outcome:
    """Run the cases with seeds from `seed` on until `inputs` or ENOUGH_FAILURES is reached."""
    cases: Counter[str] = Counter()
    statuses: Counter[int] = Counter()
    failures: list[Failure] = []
    slowest_s = largest_mb = 0.0
    done = 0
    with tempfile.TemporaryDirectory(prefix="vibrohil-fuzz-") as place:
        good = Path(place) / "good"
        good.mkdir()
        prepare(good)
        worker = Worker(kind, good)
        try:
            while done < inputs and len(failures) < ENOUGH_FAILURES:
                watched = worker.run(seed + done)
                found = watched.attempt
                cases[found.case] += 1
                statuses[found.status] += 1
                slowest_s, largest_mb = (max(slowest_s, watched.spent_s), max(largest_mb, watched.largest_mb))
                if found.wrong:
                    failures.append(Failure(seed + done, found.case, found.wrong, found.arguments))
                if not watched.alive or (done + 1) % RENEWED_AFTER == 0:
                    worker.close()
                    worker = Worker(kind, good)
                done += 1
        finally:
            worker.close()
    return Outcome(kind, done, dict(cases), dict(statuses), slowest_s, largest_mb, tuple(failures))
