"""Invalid files and options on the command line: random damage, with a seed for each input.

A process runs one command line after another. The program must end by itself with a verdict or an error
message. Failures are: a traceback, more time or memory than `watched` and `attempt` allow, a change to a file
that is not the program's, another program that is started, and a remaining temporary file. The seed repeats
a failure.
"""

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from fuzzing.attempt import Attempt, Kind, serve
from fuzzing.file_cases import prepare

ENOUGH_FAILURES = 10
RENEWED_AFTER = 200
"""Inputs for one process; memory that its libraries keep would otherwise count for later inputs."""


class Failure(NamedTuple):
    """A failure of the case with this seed, and its command line."""

    seed: int
    case: str
    what: str
    arguments: tuple[str, ...]


class Outcome(NamedTuple):
    """Numbers of inputs by case and by exit status, and all failures."""

    cases: Counter[str]
    statuses: Counter[int]
    failures: list[Failure]


def fuzz(kind: Kind, inputs: int, seed: int) -> Outcome:
    """Run the cases with seeds from `seed` on until `inputs` or ENOUGH_FAILURES is reached."""
    found = Outcome(Counter(), Counter(), [])
    waiting = range(seed, seed + inputs)
    with tempfile.TemporaryDirectory(prefix="vibrohil-fuzz-") as place:
        good = Path(place) / "good"
        good.mkdir()
        prepare(good)
        while waiting:
            for one in attempts(kind, waiting[:RENEWED_AFTER], good):
                found.cases[one.case] += 1
                found.statuses[one.status] += 1
                if one.wrong:
                    found.failures.append(Failure(waiting[0], one.case, one.wrong, one.arguments))
                if len(found.failures) == ENOUGH_FAILURES:
                    return found
                waiting = waiting[1:]
    return found


def attempts(kind: Kind, seeds: Sequence[int], good: Path) -> Iterator[Attempt]:
    """Run the cases with these seeds in a new process, up to one that ends the process."""
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=serve, args=(theirs, kind, seeds, good))
    process.start()
    theirs.close()
    case, arguments = "none", ()
    try:
        for _ in seeds:
            case, arguments = ours.recv()
            yield ours.recv()
    except EOFError:
        process.join()
        yield Attempt(case, arguments, -1, f"the process died (exit code {process.exitcode})")
    finally:
        process.kill()
        process.join()
        ours.close()
