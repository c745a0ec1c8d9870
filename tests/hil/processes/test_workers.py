"""Worker processes: they stay, and the death of one costs its task alone."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing import Pipe
from pathlib import Path

import pytest

from hil.processes import workers
from hil.processes.child import has_stopped
from hil.processes.signals import ending_signals
from hil.processes.workers import Died, WorkerDiedError, Workers, alive, results

KILLED_AT_A_START = """
import os, sys
sys.path.insert(0, sys.argv[1])
from hil.processes import workers
from test_workers import pid_after
some = workers.Workers(pid_after, 1)
print(some._started().process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


def pid_after(task: int) -> int:
    """This process's number; task 0 kills it, task 13 is refused."""
    if task == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    if task == 13:
        raise ValueError("unlucky")
    return os.getpid()


def test_a_process_stays_from_call_to_call_and_is_gone_at_the_end() -> None:
    with Workers(pid_after, 1) as some:
        first, second = (dict(some.results([task]))[task] for task in (1, 2))
        assert first == second
    with pytest.raises(ProcessLookupError):
        os.kill(alive(first), 0)


def test_a_worker_that_dies_costs_its_task_alone() -> None:
    found = dict(results(pid_after, [1, 0, 2, 3], 2))
    assert found[0] == Died("was killed by SIGKILL")
    assert all(isinstance(found[task], int) for task in (1, 2, 3))
    with pytest.raises(WorkerDiedError, match="was killed by SIGKILL; if the machine ran out of memory"):
        alive(found[0])


OF_A_PROGRAM = """
from hil.processes.workers import results

def doubled(task: int) -> int:
    return 2 * task

if __name__ == "__main__":
    print(dict(results(doubled, [1, 2], 2)))
"""


def test_the_function_may_be_one_of_the_program_itself(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(OF_A_PROGRAM)
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) in (("{1: 2, 2: 4}\n", ""), ("{2: 4, 1: 2}\n", ""))


def test_one_that_dies_between_two_calls_is_reported_as_well() -> None:
    with Workers(pid_after, 1) as some:
        [(_, pid)] = some.results([1])
        os.kill(alive(pid), signal.SIGKILL)
        assert dict(some.results([2]))[2] == Died("was killed by SIGKILL")
        assert isinstance(dict(some.results([3]))[3], int)


def stopped(task: int) -> int:
    """Task 0 stops its process for ever."""
    if task == 0:
        os.kill(os.getpid(), signal.SIGSTOP)
    return task


def test_a_worker_that_is_stopped_for_long_costs_its_task_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.processes.workers.LOOK_S", 0.1)
    found = dict(results(stopped, [0, 1], 2))
    assert found == {0: Died("was stopped by a signal, and after 1 s killed"), 1: 1}


def test_a_worker_that_is_stopped_while_idle_does_not_hold_the_program() -> None:
    with Workers(pid_after, 1) as some:
        pid = alive(dict(some.results([1]))[1])
        os.kill(pid, signal.SIGSTOP)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def asked_to_end(_: int) -> None:
    """SIGTERM comes."""
    with ending_signals():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(10.0)


def test_a_worker_that_is_asked_to_end_says_by_what() -> None:
    assert list(results(asked_to_end, [1], 1)) == [(1, Died("was killed by SIGTERM"))]


def test_a_worker_does_not_outlive_a_program_that_is_killed_while_it_begins() -> None:
    """Its first breath is after the program's last; the kernel has been asked before."""
    program = subprocess.run(
        [sys.executable, "-c", KILLED_AT_A_START, str(Path(__file__).parent)],
        capture_output=True,
        text=True,
        check=False,
    )
    worker = int(program.stdout)
    deadline_s = time.monotonic() + 1.0
    while not has_stopped(worker) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert has_stopped(worker)


TEMPORARY = """
import os, sys, tempfile
sys.path.insert(0, sys.argv[1])
from hil.processes.workers import Workers
from test_workers import temporary_folder
with Workers(temporary_folder, 2) as some:
    for task, folder in some.results(["kept", sys.argv[2]]):
        print(folder, flush=True)
    os.kill(os.getpid(), int(sys.argv[3]))
"""


def temporary_folder(task: str) -> str:
    """Make a temporary folder with a file and leave it; "killed" kills the process."""
    folder = Path(tempfile.mkdtemp())
    (folder / "file").write_text(task)
    if task == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    return str(folder)


@pytest.mark.parametrize(("task", "number"), [("killed", 0), ("idle", signal.SIGKILL), ("idle", 0)])
def test_no_temporary_file_of_a_worker_remains_whoever_is_killed(
    task: str, number: int, tmp_path: Path
) -> None:
    program = subprocess.run(
        [sys.executable, "-c", TEMPORARY, str(Path(__file__).parent), task, str(number)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert program.returncode == -number
    assert str(tmp_path) in program.stdout, program.stderr
    deadline_s = time.monotonic() + 2.0
    while list(tmp_path.iterdir()) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_whose_program_is_gone_with_an_answer_unread_ends_in_silence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, theirs = Pipe()
    ours.send(workers.own_modules())
    ours.send((pid_after, None))
    theirs.send("unread")
    ours.close()
    monkeypatch.setattr("sys.argv", ["worker", str(os.dup(theirs.fileno())), str(os.getppid())])
    workers.main()
    theirs.close()


def test_what_a_task_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="unlucky"):
        list(results(pid_after, [1, 13], 1))
