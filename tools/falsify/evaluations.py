"""The runs of a search on workers, stored as they end, so that the same command continues after any end."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hil.record import provenance
from hil.record.run_folder import RUNS
from tools import jobs
from tools.falsify.objective import Result, Task, run_task
from tools.falsify.space import Space
from tools.progress import Progress
from tools.study import work

RUNS_A_TASK = 1
KIND = "runs"
"""Beginning of the names of stored results."""


def folder_of(spaces: Sequence[Space]) -> Path:
    """The folder of stored results, by a digest of what they depend on; a larger budget has the same."""
    return RUNS / f"falsify-{provenance.key(list(spaces))[:16]}"


class Evaluations:
    """The results of runs, from memory, from the folder of stored results, or from the workers."""

    def __init__(self, folder: Path, run: "jobs.Run[Task, list[dict[str, Any]]]", progress: Progress) -> None:
        self.known: dict[tuple[str, tuple[Any, ...]], Result] = {}
        self._folder, self._run, self._progress = folder, run, progress
        self.taken_over = 0
        """Number of results that were stored before."""
        self.smallest: float | None = None
        """The smallest margin so far."""

    def results(
        self, space: Space, values: Sequence[tuple[Any, ...]], in_words: str = "repeating runs"
    ) -> list[Result]:
        """The results of runs with these values, in their order."""
        missing = [one for one in dict.fromkeys(values) if (space.name, one) not in self.known]
        tasks = [
            Task(space.name, tuple(missing[k : k + RUNS_A_TASK])) for k in range(0, len(missing), RUNS_A_TASK)
        ]
        paths = work.paths_of(KIND, tasks, self._folder)
        left = []
        for task, path in zip(tasks, paths, strict=True):
            stored = work.read_stored(path, task)
            if stored is None:
                left.append((task, path))
                continue
            self.taken_over += len(stored)
            self._keep(task, stored)
        for number, found in self._run([task for task, _ in left]) if left else ():
            task, path = left[number]
            work.store(path, task, found)
            self._keep(task, found)
            best = "" if self.smallest is None else f", smallest margin {self.smallest:.3f}"
            self._progress(None, f"{in_words}: {len(self.known)} runs{best}")
        return [self.known[space.name, one] for one in values]

    def _keep(self, task: Task, found: Sequence[dict[str, Any]]) -> None:
        for values, one in zip(task.values, found, strict=True):
            self.known[task.space, values] = result = Result(tuple(one["margins"]), one["why"])
            if result.margin is not None:
                self.smallest = min(result.margin, math.inf if self.smallest is None else self.smallest)

    @property
    def unjudged(self) -> dict[str, int]:
        """The numbers of runs that are not judged, by the first reason of each kind."""
        reasons = [one.why for one in self.known.values() if one.why]
        kinds = Counter(one.partition(":")[0] for one in reasons)
        return {next(one for one in reasons if one.startswith(kind)): n for kind, n in kinds.items()}


def runner(spaces: Sequence[Space]) -> Callable[[Task], list[dict[str, Any]]]:
    """The function of the workers."""
    return partial(run_task, {space.name: space for space in spaces})
