"""What not every machine has: without it a test is skipped, naming what is missing, but never in CI."""

import os
from collections.abc import Sequence

import pytest


def require(missing: Sequence[str], remedy: str) -> None:
    """Skip the test where something is missing; on a CI machine, which must have it, fail it."""
    if missing:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"{' and '.join(missing)} missing; {remedy}")
