"""The programs that the emulated board needs: a compiler, a C library and an emulator."""

import shutil
import subprocess
from pathlib import Path

COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
REMEDY = (
    "install Debian's packages: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
)


def find_missing_tools() -> list[str]:
    """The names of the missing programs and libraries."""
    missing = [program for program in (COMPILER, EMULATOR) if shutil.which(program) is None]
    if COMPILER not in missing:
        found = subprocess.run(
            [COMPILER, "-print-file-name=libc_nano.a"], capture_output=True, text=True, check=True
        )
        if not Path(found.stdout.strip()).is_absolute():
            missing.append("newlib")
    return missing
