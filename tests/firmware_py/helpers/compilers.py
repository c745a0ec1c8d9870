"""The compilers of the emitted C."""

import shutil

from lacking import require


def require_compiler(program: str) -> None:
    """Skip where it is missing; on a CI machine that is a failure: nothing was compiled."""
    require([] if shutil.which(program) else [program], f"apt-get install {program}")
