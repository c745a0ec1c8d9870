"""Worker processes for independent tasks.

If a worker is killed, for example for lack of memory, only its present task is lost. When the program ends,
all workers end at once, even during a task. Ctrl-C reaches the program alone.

The workers' temporary files are in a folder of their own. A shell process removes it as soon as the program
and all workers have ended, so that no kill leaves a file behind.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import spawn
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any, Generic, NamedTuple, Self, TypeVar

from hil.processes.child import has_stopped
from hil.processes.signals import Interrupted
from hil.timing.realtime import collect_rarely, end_with_parent
from text_input import RefusalError

Task = TypeVar("Task")
Result = TypeVar("Result")

JOIN_TIMEOUT_S = 1.0
LOOK_S = 1.0
"""Period at which the workers are checked."""
MOST_LOOKS_STOPPED = 10
"""Successive checks after which a stopped worker is killed; none takes place while the program is stopped."""
PROGRAM = "from hil.processes.workers import main; main()"
REMOVAL = """trap "" INT HUP TERM; read -r _; exec rm -rf -- "$1" """
"""Shell program that removes a folder once every writer of its standard input has ended."""


class WorkerDiedError(RefusalError, RuntimeError):
    """A worker ended during a task whose result is required."""


class Died(NamedTuple):
    """Replaces the result of a task whose worker ended; `how` describes the end."""

    how: str


@dataclass(eq=False)
class Worker:
    """A worker process, and the program's end of its pipe."""

    process: "subprocess.Popen[bytes]"
    pipe: Connection
    looks_stopped: int = 0
    """Successive checks that found the process stopped."""

    def look(self) -> None:
        """Check the process, and kill it if it has been stopped for too long."""
        self.looks_stopped = self.looks_stopped + 1 if has_stopped(self.process.pid) else 0
        if self.looks_stopped > MOST_LOOKS_STOPPED:
            self.process.kill()

    def death(self) -> Died:
        """Describe the worker's end."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(JOIN_TIMEOUT_S)
        status = self.process.returncode
        if status is None or status >= 0:
            return Died(f"ended with status {status}")
        if self.looks_stopped > MOST_LOOKS_STOPPED:
            return Died(f"was stopped by a signal, and after {MOST_LOOKS_STOPPED * LOOK_S:.0f} s killed")
        return Died(f"was killed by {signal.Signals(-status).name}")


def main() -> None:
    """Run a worker; its arguments are the descriptor of its pipe and the program's process id."""
    collect_rarely()
    pipe, program = Connection(int(sys.argv[1])), int(sys.argv[2])
    if os.getppid() != program:  # the program was killed while this process started
        return
    try:
        spawn.prepare(pipe.recv())
        serve(pipe, pipe.recv())
    except (EOFError, ConnectionError):  # the program has closed the pipe, or has ended
        return
    except Interrupted:  # the task has cleaned up; the program sees the signal by which this process ends
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTERM)


def serve(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """In a worker: receive tasks and send results until the end of the pipe raises an exception."""
    while True:
        task = pipe.recv()
        try:
            answer: tuple[Any, Exception | None] = (function(task), None)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = (None, error)
        pipe.send(answer)


def own_modules() -> dict[str, Any]:
    """The program's main module and search path for `spawn.prepare`."""
    data: dict[str, Any] = spawn.get_preparation_data("worker")
    del data["authkey"]  # a pipe needs no key
    return data


killed_with_parent = partial(end_with_parent, signal.SIGKILL)
"""Called in a worker before its program begins, so that the worker ends with the program from the outset."""


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Let processes that start within the block ignore SIGINT and SIGHUP, which are left to this process."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class TemporaryFolder:
    """A folder for temporary files, removed when this process and all holders of `held` have ended or closed.

    This holds for any end, SIGKILL included, since the kernel closes a process's descriptors.
    """

    def __init__(self) -> None:
        self.path = tempfile.mkdtemp(prefix="vibrohil-workers-")
        ours, self.held = os.pipe()
        self._removal = subprocess.Popen(
            ["sh", "-c", REMOVAL, "sh", self.path], stdin=ours, start_new_session=True
        )
        os.close(ours)

    def close(self) -> None:
        """Close this process's end and wait until the folder is removed."""
        os.close(self.held)
        self._removal.wait()


class Workers(Generic[Task, Result]):
    """At most `processes` workers that run `function` on one task after another.

    They start when needed and remain, with their compiled code, until the block ends.
    """

    def __init__(self, function: Callable[[Task], Result], processes: int) -> None:
        self._function = function
        self._processes = processes
        self._idle: list[Worker] = []
        self._busy: list[tuple[Worker, Task]] = []
        self._temporary: TemporaryFolder | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._give_up()
        for worker in self._idle:  # idle workers end when their pipe closes, all at once
            worker.pipe.close()
        for worker in self._idle:
            try:
                worker.process.wait(JOIN_TIMEOUT_S)
            except subprocess.TimeoutExpired:  # a stopped process does not see that its pipe has closed
                worker.process.kill()
                worker.process.wait()
        self._idle.clear()
        if self._temporary is not None:
            self._temporary.close()
            self._temporary = None

    def results(self, tasks: Sequence[Task]) -> Generator[tuple[Task, Result | Died]]:
        """Yield each task with its result in the order of completion.

        An exception of `function` is raised here. Closing the iterator kills the workers with a task.
        """
        waiting = deque(tasks)
        due_s = time.monotonic() + LOOK_S
        try:
            while waiting or self._busy:
                while waiting and len(self._busy) < self._processes:
                    self._begin(self._idle.pop() if self._idle else self._started(), waiting.popleft())
                ready = wait([worker.pipe for worker, _ in self._busy], LOOK_S)
                if time.monotonic() >= due_s:
                    due_s = time.monotonic() + LOOK_S
                    for worker, _ in self._busy:
                        worker.look()
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
        with suppress(BrokenPipeError):  # the worker ended while idle; `results` sees the end of its pipe
            worker.pipe.send(task)

    def _give_up(self) -> None:
        for worker, _ in self._busy:
            worker.process.kill()
        for worker, _ in self._busy:
            worker.process.wait()
        self._busy.clear()

    def _started(self) -> Worker:
        ours, theirs = Pipe()
        if self._temporary is None:
            self._temporary = TemporaryFolder()
        with theirs, interrupts_blocked():
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", PROGRAM, str(theirs.fileno()), str(os.getpid())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno(), self._temporary.held],
                env={**os.environ, "TMPDIR": self._temporary.path},
                preexec_fn=killed_with_parent,  # noqa: PLW1509  one system call, no lock
            )
        with suppress(BrokenPipeError):  # the worker has already ended; `results` sees the end of its pipe
            ours.send(own_modules())
            ours.send(self._function)
        return Worker(process, ours)


def results(
    function: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Generator[tuple[Task, Result | Died]]:
    """Like `Workers.results`, with workers for these tasks only."""
    with Workers(function, processes) as workers:
        yield from workers.results(tasks)


def alive(result: Result | Died) -> Result:
    """Return the result; raises WorkerDiedError if the worker ended without one."""
    if isinstance(result, Died):
        raise WorkerDiedError(
            f"a worker process {result.how}; if the machine ran out of memory, run fewer at the same time"
        )
    return result
