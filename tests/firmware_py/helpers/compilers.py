"""The compilers of the emitted C."""

import os
import shutil

import pytest


def require_compiler(program: str) -> None:
    """Skip where it is missing, naming it; on a CI machine that is a failure: nothing was compiled."""
    if shutil.which(program) is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"{program} missing; apt-get install it")
