"""No test here is about worker processes."""

from collections.abc import Iterator

import pytest
from in_process import without_workers


@pytest.fixture(scope="module", autouse=True)
def no_workers() -> Iterator[None]:
    """Run every task in this process, also in the fixtures of a module."""
    with without_workers():
        yield
