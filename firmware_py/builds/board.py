"""The firmware for a Cortex-M, linked with a small main program for QEMU's emulated board.

The image reads requests from standard input and answers on standard output; see `board_image/main.c`.
"""

import hashlib
import subprocess
import tempfile
from pathlib import Path
from typing import Literal

from firmware_py.builds.board_tools import COMPILER, EMULATOR, REMEDY, find_missing_tools
from firmware_py.builds.c99.header import header
from firmware_py.builds.c_compiler import TARGETS, cache_file, object_code
from text_input import RefusalError

SOURCES = Path(__file__).parent / "board_image"
BoardName = Literal["cortex-m7", "cortex-m4f"]


MACHINES: dict[BoardName, str] = {"cortex-m7": "mps2-an500", "cortex-m4f": "mps2-an386"}
"""QEMU's names of the boards."""
OPTIONS = ("-std=c11", "-O2", "-ffp-contract=off", "-nostartfiles", "-nostdlib")
LIBRARIES = ("-lm", "-lc", "-lgcc")
"""libm provides only `floorf` and `rintf`, which are exact, on processors without such instructions."""
EMULATION = (
    *("-display", "none", "-monitor", "none", "-serial", "none"),
    *("-icount", "shift=6,align=off,sleep=off", "-semihosting-config", "enable=on,target=native"),
)
"""Each instruction takes 64 ns of the board's own time, so that two runs are equal."""
TIMER_TICKS_AN_INSTRUCTION = 64.0 / 40.0
"""The board's timer runs at 25 MHz."""


class BoardError(RefusalError, ValueError):
    """The image cannot be built or run here; the message names the remedy."""


def refuse_without_tools() -> None:
    """Raise BoardError if a program or library is missing."""
    if missing := find_missing_tools():
        raise BoardError(f"an emulated Cortex-M needs {' and '.join(missing)}; {REMEDY}")


def emulator(name: BoardName, image: Path) -> list[str]:
    """The emulator's command for an image on a board."""
    return [EMULATOR, "-machine", MACHINES[name], *EMULATION, "-kernel", str(image)]


def image(name: BoardName) -> Path:
    """The path of the linked image; it is built after a change of the firmware."""
    refuse_without_tools()
    sources = b"".join(path.read_bytes() for path in sorted(SOURCES.iterdir()))
    digest = hashlib.sha256(sources).hexdigest()[:16]
    return cache_file(f"{name}-{digest}.elf", lambda: link(name))


def link(name: BoardName) -> bytes:
    """Link the image."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "vibro_firmware.o").write_bytes(object_code(name))
        (folder / "vibro_firmware.h").write_text(header(TARGETS[name].precision), encoding="utf-8")
        linked = folder / "image.elf"
        parts = [str(SOURCES / "main.c"), str(folder / "vibro_firmware.o"), "-T", str(SOURCES / "mps2.ld")]
        command = [
            COMPILER,
            *TARGETS[name].options,
            *OPTIONS,
            "-I",
            str(folder),
            *parts,
            *LIBRARIES,
            "-o",
            str(linked),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BoardError(f"{COMPILER} cannot link the image: {done.stderr.strip()}")
        return linked.read_bytes()


def start(name: BoardName) -> "subprocess.Popen[bytes]":
    """Start the emulator: a board after power-up."""
    return subprocess.Popen(emulator(name, image(name)), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
