"""The runs of a search on workers, stored as they end, so that the same command continues after any end."""

import math
import re
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

KIND = "runs"
"""Beginning of the names of stored results."""
NUMBER = re.compile(r"\d+(\.\d+)?(e[-+]?\d+)?")


def folder_of(spaces: Sequence[Space]) -> Path:
    """The folder of stored results, by a digest of what they depend on; a larger budget has the same."""
    return RUNS / f"falsify-{provenance.key(list(spaces))[:16]}"


class Evaluations:
    """The results of runs, from memory, from the folder of stored results, or from the workers."""

    def __init__(self, folder: Path, run: "jobs.Run[Task, dict[str, Any]]", progress: Progress) -> None:
        self.known: dict[Task, Result] = {}
        self._folder, self._run, self._progress = folder, run, progress
        self._smallest = math.inf
        self.taken_over = 0
        """Number of results that were stored before."""

    def results(
        self, space: Space, values: Sequence[tuple[Any, ...]], in_words: str = "repeating runs"
    ) -> list[Result]:
        """The results of runs with these values, in their order."""
        wanted = [Task(space.name, one) for one in values]
        missing = [task for task in dict.fromkeys(wanted) if task not in self.known]
        paths = dict(zip(missing, work.paths_of(KIND, missing, self._folder), strict=True))
        for task, path in paths.items():
            if (stored := work.read_stored(path, task)) is not None:
                self.taken_over += 1
                self._keep(task, stored)
        left = [task for task in missing if task not in self.known]
        for number, found in self._run(left) if left else ():
            task = left[number]
            work.store(paths[task], task, found)
            self._keep(task, found)
            best = f", smallest margin {self._smallest:.3f}" if self._smallest < math.inf else ""
            self._progress(None, f"{in_words}: {len(self.known)} runs{best}")
        return [self.known[task] for task in wanted]

    def _keep(self, task: Task, found: dict[str, Any]) -> None:
        self.known[task] = result = Result(tuple(found["margins"]), found["why"])
        if result.margin is not None:
            self._smallest = min(result.margin, self._smallest)

    @property
    def unjudged(self) -> dict[str, int]:
        """The numbers of runs that are not judged, by the first of reasons that differ in numbers."""
        kinds: dict[str, list[str]] = {}
        for one in self.known.values():
            if one.why:
                kinds.setdefault(NUMBER.sub("#", one.why), []).append(one.why)
        return {reasons[0]: len(reasons) for reasons in kinds.values()}


def runner(spaces: Sequence[Space]) -> Callable[[Task], dict[str, Any]]:
    """The function of the workers."""
    return partial(run_task, {space.name: space for space in spaces})
