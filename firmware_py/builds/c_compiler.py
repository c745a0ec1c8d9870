"""The firmware's object file for a board or this machine: the emitted C, compiled by gcc."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

import llvmlite.binding as llvm

from compilation.kernel_cache import folder_of, kept_file
from firmware_py.builds.c99.emitter import emit
from firmware_py.builds.c99.folder import CPUS, OPTIONS
from firmware_py.builds.c99.header import header
from firmware_py.builds.flat import Precision, layout
from firmware_py.core.config import Config
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import Tx
from text_input import RefusalError

HostName = Literal["host", "host-single"]
TargetName = Literal["cortex-m7", "cortex-m4f"] | HostName
TEMPLATES = Path(__file__).parent / "c99" / "templates"
SHARED = ("-shared", "-fPIC")


def cache_file(name: str, make: Callable[[], bytes]) -> Path:
    """Path of a cached file of what `make` returns, which depends on the firmware's sources alone."""
    return kept_file(folder_of("firmware_py.builds.c99", *sorted(TEMPLATES.iterdir())), name, make)


class CompilerError(RefusalError, ValueError):
    """The emitted C cannot be compiled here; the message names the remedy."""


class Target(NamedTuple):
    """A compiler for a machine, its Debian package, its options and the precision of every float."""

    compiler: str
    package: str
    options: tuple[str, ...]
    precision: Precision


SMALL = ("-Os", "-fno-partial-inlining", "--param", "large-function-insns=1000")
"""Less flash, and no slower on a board without a cache for instructions. gcc inlines a function that is
called once also into a large one, where it takes 3 % more; here fewer instructions count as large."""
ARM = ("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
HOST = ("gcc", "gcc libc6-dev")
TARGETS: dict[TargetName, Target] = {
    "cortex-m7": Target(*ARM, ("-mthumb", *CPUS["cortex_m7"], *SMALL), "double"),
    "cortex-m4f": Target(*ARM, ("-mthumb", *CPUS["cortex_m4f"], *SMALL), "single"),
    "host": Target(*HOST, ("-fPIC",), "double"),
    "host-single": Target(*HOST, ("-fPIC",), "single"),
}


def missing_compiler(target: TargetName) -> str:
    """A sentence if the target's compiler is missing; else empty."""
    found = TARGETS[target]
    if shutil.which(found.compiler) is not None:
        return ""
    return f"{target} needs {found.compiler}; install Debian's package: apt-get install {found.package}"


def object_code(target: TargetName, has_gait: bool = True) -> bytes:
    """The firmware as a relocatable object file; raise CompilerError without a compiler."""
    return _kept(target, has_gait, "o", "-c").read_bytes()


def shared_library(target: HostName) -> Path:
    """The firmware as a library for this machine; raise CompilerError without a compiler."""
    return _kept(target, True, "so", *SHARED)


def _kept(target: TargetName, has_gait: bool, ending: str, *options: str) -> Path:
    if missing := missing_compiler(target):
        raise CompilerError(missing)
    name = f"{target}{'' if has_gait else '-without-gait'}.{ending}"
    return cache_file(name, lambda: _compile(target, has_gait, *options))


def _compile(target: TargetName, has_gait: bool, *options: str) -> bytes:
    compiler, _, own, precision = TARGETS[target]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "vibro_firmware.c").write_text(emit(precision, has_gait).text(), encoding="utf-8")
        (folder / "vibro_firmware.h").write_text(header(precision), encoding="utf-8")
        made = folder / "made"
        command = [compiler, *OPTIONS, *own, *options, str(folder / "vibro_firmware.c"), "-o", str(made)]
        libraries = ["-lm"] if options == SHARED else []
        done = subprocess.run([*command, *libraries], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompilerError(f"{compiler} cannot compile the firmware: {done.stderr.strip()}")
        return made.read_bytes()


def measure_sizes(target: TargetName, has_gait: bool = True) -> dict[str, int]:
    """Bytes of the target's object file in flash, and of its caller's structs in RAM."""
    code, precision = object_code(target, has_gait), TARGETS[target].precision
    text = constants = 0
    for section in llvm.ObjectFileRef.from_data(code).sections():  # an iterator that reuses one object
        text += section.size() if section.is_text() else 0
        constants += section.size() if (section.name() or b"").startswith(b".rodata") else 0
    records = {"config": Config, "state": FirmwareState, "tx": Tx}
    structs = {name: layout(kind, precision).itemsize for name, kind in records.items()}
    return {"code": text, "constants": constants, **structs}
