"""Worker processes for tasks that do not depend on each other.

The death of a worker, for memory perhaps, costs only the task it was at. When the program ends or gives up
early, all workers end at once, with whatever they were doing. Ctrl-C reaches the program alone.
"""

import multiprocessing
import signal
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, NamedTuple, Self, TypeVar

from hil.timing.realtime import die_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")

JOIN_TIMEOUT_S = 1.0


class WorkerDiedError(RuntimeError):
    """A worker died at a task that cannot be done without."""


class Died(NamedTuple):
    """In place of a result: how the worker ended that was at the task."""

    how: str


@dataclass(eq=False)
class Worker:
    """One process, and our end of its pipe."""

    process: BaseProcess
    pipe: Connection

    def death(self) -> Died:
        """How it ended."""
        self.process.join(JOIN_TIMEOUT_S)
        status = self.process.exitcode
        if status is None or status >= 0:
            return Died(f"ended with status {status}")
        return Died(f"was killed by {signal.Signals(-status).name}")

    def end(self) -> None:
        """Let it go in order: it waits for a task."""
        self.pipe.close()
        self.process.join()


def serve(pipe: Connection, function: Callable[[Any], Any], prepare: Callable[[], None] | None) -> None:
    """In a worker: take tasks and give results until the program closes the pipe."""
    die_with_parent()
    program = multiprocessing.parent_process()
    if program is None or not program.is_alive():  # it was killed while this process began
        return
    if prepare is not None:
        prepare()
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        try:
            answer: tuple[Any, Exception | None] = (function(task), None)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = (None, error)
        pipe.send(answer)


@contextmanager
def deaf_children() -> Iterator[None]:
    """Processes that start meanwhile leave a terminal's Ctrl-C and its end to this one."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Workers(Generic[Task, Result]):
    """At most `processes` that run `function` on one task after the other; `prepare` is called in each.

    They start as they are needed and stay, with what they have compiled, until the block ends.
    """

    def __init__(
        self,
        function: Callable[[Task], Result],
        processes: int,
        prepare: Callable[[], None] | None = None,
    ) -> None:
        self._serve = (function, prepare)
        self._processes = processes
        self._context = multiprocessing.get_context("spawn")
        self._idle: list[Worker] = []
        self._busy: list[tuple[Worker, Task]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._give_up()
        for worker in self._idle:
            worker.end()
        self._idle.clear()

    def results(self, tasks: Sequence[Task]) -> Generator[tuple[Task, Result | Died]]:
        """Each task with its result as they come.

        What `function` raises is raised here. Closing the iterator ends the workers that are at a task.
        """
        waiting = deque(tasks)
        try:
            while waiting or self._busy:
                while waiting and len(self._busy) < self._processes:
                    self._begin(self._idle.pop() if self._idle else self._started(), waiting.popleft())
                ready = wait([worker.pipe for worker, _ in self._busy])
                for one in [one for one in self._busy if one[0].pipe in ready]:
                    worker, task = one
                    try:
                        result, error = worker.pipe.recv()
                    except (EOFError, ConnectionError):
                        self._busy.remove(one)
                        yield task, worker.death()
                        continue
                    if error is not None:
                        raise error
                    self._busy.remove(one)
                    if waiting:
                        self._begin(worker, waiting.popleft())
                    else:
                        self._idle.append(worker)
                    yield task, result
        finally:
            self._give_up()

    def _begin(self, worker: Worker, task: Task) -> None:
        self._busy.append((worker, task))
        with suppress(BrokenPipeError):  # it has died while it was idle; its pipe's end says so to `results`
            worker.pipe.send(task)

    def _give_up(self) -> None:
        for worker, _ in self._busy:
            worker.process.kill()
        for worker, _ in self._busy:
            worker.process.join()
        self._busy.clear()

    def _started(self) -> Worker:
        ours, theirs = self._context.Pipe()
        with deaf_children():
            process = self._context.Process(target=serve, args=(theirs, *self._serve), daemon=True)
            process.start()
        theirs.close()
        return Worker(process, ours)


def results(
    function: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Generator[tuple[Task, Result | Died]]:
    """The same, by workers for these tasks alone."""
    with Workers(function, processes) as workers:
        yield from workers.results(tasks)


def alive(result: Result | Died) -> Result:
    """The result; raise WorkerDiedError where there is none."""
    if isinstance(result, Died):
        raise WorkerDiedError(f"a worker {result.how}; where it lacked memory, run fewer at once")
    return result
