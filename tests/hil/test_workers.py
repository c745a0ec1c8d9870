"""Worker processes: they stay, and the death of one costs its task alone."""

import os
import signal

import pytest

from hil.bench.workers import Died, WorkerDiedError, Workers, alive, results


def pid_after(task: int) -> int:
    """This process's number; task 0 kills it, task 13 is refused."""
    if task == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    if task == 13:
        raise ValueError("unlucky")
    return os.getpid()


def test_a_process_stays_from_call_to_call_and_is_gone_at_the_end() -> None:
    with Workers(pid_after, 1) as workers:
        first, second = (dict(workers.results([task]))[task] for task in (1, 2))
        assert first == second
    with pytest.raises(ProcessLookupError):
        os.kill(alive(first), 0)


def test_a_worker_that_dies_costs_its_task_alone() -> None:
    found = dict(results(pid_after, [1, 0, 2, 3], 2))
    assert found[0] == Died("was killed by SIGKILL")
    assert all(isinstance(found[task], int) for task in (1, 2, 3))
    with pytest.raises(WorkerDiedError, match="was killed by SIGKILL; where it lacked memory"):
        alive(found[0])


def test_one_that_dies_between_two_calls_is_told_as_well() -> None:
    with Workers(pid_after, 1) as workers:
        [(_, pid)] = workers.results([1])
        os.kill(alive(pid), signal.SIGKILL)
        assert dict(workers.results([2]))[2] == Died("was killed by SIGKILL")
        assert isinstance(dict(workers.results([3]))[3], int)


def test_what_a_task_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="unlucky"):
        list(results(pid_after, [1, 13], 1))
