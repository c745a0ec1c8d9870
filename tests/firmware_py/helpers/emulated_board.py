"""The programs that an emulated board needs."""

import os

import pytest

from firmware_py.builds import board_tools


def require_board_programs() -> None:
    """Skip where they are missing; on a CI machine that is a failure: no board was tested."""
    missing = board_tools.find_missing_tools()
    if missing and os.environ.get("CI"):
        pytest.fail(f"{' and '.join(missing)} missing on a CI machine; {board_tools.REMEDY}")
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing; {board_tools.REMEDY}")
