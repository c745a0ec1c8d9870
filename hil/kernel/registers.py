"""A library for user-mode Linux on processors with AMX, whose registers it cannot set by itself."""

import shutil
import subprocess
from pathlib import Path
from typing import Final

COMPILER: Final = "gcc"
REMEDY: Final = "install a C compiler: apt-get install gcc libc6-dev"
SOURCE: Final = Path(__file__).with_name("registers.c")


class RegistersError(ValueError):
    """The library cannot be made; the message names the remedy."""


def has_amx(cpuinfo: str) -> bool:
    """Whether the first processor of a text like /proc/cpuinfo has AMX, and so registers of 11,008 bytes."""
    flags = next((line for line in cpuinfo.splitlines() if line.startswith("flags")), "")
    return "amx_tile" in flags.split()


def make_library(folder: Path) -> Path:
    """Compile `registers.c` into `folder`; raises RegistersError without a compiler."""
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise RegistersError(
            "this processor has AMX, for which user-mode Linux needs a small library, and there is no "
            f"{COMPILER} to make it; {REMEDY}"
        )
    library = folder / "registers.so"
    made = subprocess.run(
        [compiler, "-shared", "-fPIC", "-O2", "-o", library, SOURCE],
        check=False,
        capture_output=True,
        text=True,
    )
    if made.returncode:
        raise RegistersError(f"{COMPILER} cannot make user-mode Linux's library; {REMEDY}: {made.stderr}")
    return library
