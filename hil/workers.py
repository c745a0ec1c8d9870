"""Worker processes for tasks that do not depend on each other.

The death of a worker, for memory perhaps, costs only the task it was at. When the program ends or gives up
early, all workers end at once, with whatever they were doing. Ctrl-C reaches the program alone.
"""

import multiprocessing
import signal
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, NamedTuple, TypeVar

from hil.realtime import die_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")

JOIN_TIMEOUT_S = 1.0


class Died(NamedTuple):
    """In place of a result: how the worker ended that was at the task."""

    how: str


@dataclass
class Worker(Generic[Task]):
    """One process, and the task it is at."""

    process: BaseProcess
    pipe: Connection
    task: Task

    def death(self) -> Died:
        """How it ended."""
        self.process.join(JOIN_TIMEOUT_S)
        status = self.process.exitcode
        if status is None or status >= 0:
            return Died(f"ended with status {status}")
        return Died(f"was killed by {signal.Signals(-status).name}")


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


def results(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    processes: int,
    prepare: Callable[[], None] | None = None,
) -> Generator[tuple[Task, Result | Died]]:
    """Each task with its result as they come, from at most `processes`; `prepare` is called in each.

    What `function` raises is raised here. Closing the iterator ends all workers.
    """
    context = multiprocessing.get_context("spawn")
    waiting = deque(tasks)
    workers: list[Worker[Task]] = []

    def start(task: Task) -> None:
        ours, theirs = context.Pipe()
        with deaf_children():
            process = context.Process(target=serve, args=(theirs, function, prepare), daemon=True)
            process.start()
        theirs.close()
        workers.append(Worker(process, ours, task))
        ours.send(task)

    try:
        while waiting or workers:
            while waiting and len(workers) < processes:
                start(waiting.popleft())
            ready = wait([worker.pipe for worker in workers])
            for worker in [one for one in workers if one.pipe in ready]:
                done = worker.task
                try:
                    result, error = worker.pipe.recv()
                except (EOFError, ConnectionError):
                    workers.remove(worker)
                    yield done, worker.death()
                    continue
                if error is not None:
                    raise error
                if waiting:
                    worker.task = waiting.popleft()
                    worker.pipe.send(worker.task)
                else:
                    workers.remove(worker)
                    worker.pipe.close()
                yield done, result
    finally:
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.process.join()
