"""Suites and campaigns in the process of the test: a worker takes longer to start than a short run."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from hil.processes.workers import Workers


@contextmanager
def without_workers() -> Iterator[None]:
    """Let `Workers.results` run its tasks in this process."""

    def results(some: Workers[Any, Any], tasks: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        return ((task, some._function(task)) for task in tasks)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workers, "results", results)
        yield
