"""The firmware as an object file for any target: numba's unoptimised code, compiled by LLVM alone.

    int32_t vibro_tick(const vibro_config *, vibro_firmware_state *, int64_t behind_ticks,
                       int64_t frame_count, const vibro_word_frame *, vibro_tx *)
    int32_t vibro_calibrate(vibro_config *, vibro_firmware_state *)

They return 0; `vibro_tick` another number with state and tx unchanged if the arithmetic failed. The object
also holds the constant `vibro_initial_state`. It requires functions for operations without an instruction on
its target and for copying and filling memory, but no operating system and no inexact mathematics of a C
library, whose last bits differ from another's.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

import llvmlite.binding as llvm

from firmware_py.builds import single_precision
from firmware_py.builds.flat import Precision, in_precision, layout, stored
from firmware_py.core.config import Config
from firmware_py.node.memory import INITIAL, FirmwareState
from firmware_py.node.tick import Tx
from kernel_cache import folder_of, kept_file

HostName = Literal["host", "host-single"]
TargetName = Literal["cortex-m7", "cortex-m4f"] | HostName


class Target(NamedTuple):
    """A machine in the terms of LLVM."""

    triple: str
    cpu: str
    features: str
    relocation: str
    precision: Precision
    """Precision of every float, in structs, registers and constants: see `single_precision`."""


_ARM = "thumbv7em-none-unknown-eabihf"
TARGETS: dict[TargetName, Target] = {
    "cortex-m7": Target(_ARM, "cortex-m7", "+fp-armv8d16,+fp64", "static", "double"),
    "cortex-m4f": Target(_ARM, "cortex-m4", "+vfp4d16sp,-fp64", "static", "single"),
    "host": Target(llvm.get_default_triple(), "", "", "pic", "double"),
    "host-single": Target(llvm.get_default_triple(), "", "", "pic", "single"),
}
"""The host's features are not used: a fused multiply-add that another target lacks would change bits."""

BUILDERS = sorted(Path(__file__).parent.glob("*.py"))
"""The modules that make the code; the cache is keyed by them and by all that they import."""
ENTRY, CALIBRATE = "vibro_tick", "vibro_calibrate"
NO_GAIT = "without-gait"
"""Argument of `raw_ir`, and part of the names of files, for code that does not follow a gait."""
RAW = {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}
"""Numba's settings in a process that writes raw assembly; it compiles even where kernels are interpreted."""
SPEED = 2
LLVM_REGION_BUDGET = 10_000
"""LLVM's default of the limit that `whole_registers` sets."""
MOST_ARGUMENTS = 100
"""A function with more arguments is inlined: numba passes each number of a record as an argument of its own,
and LLVM cannot compile a call with kilobytes of arguments for ARM."""
INLINED = ("9interface7framing", "12replacements10_with_page")
"""Parts of mangled names. These functions are inlined too: frame lengths become constants, and of all the
parameters only those are copied that a commit checks."""
APART = ("4node3xcp5serve", "12replacements8put_page")
"""Parts of mangled names. These functions, which a tick seldom or never calls, are not inlined."""
WRAPPER = """
define i32 @vibro_tick(ptr %config, ptr %state, i64 %current, i64 %count, ptr %frames, ptr %tx) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{tick}(
    ptr %returned, ptr %raised,
    ptr %config, ptr %state, i64 %current, i64 %count, ptr %frames, ptr %tx)
  ret i32 %status
}}
define i32 @vibro_calibrate(ptr %config, ptr %state) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{calibrate}(ptr %returned, ptr %raised, ptr %config, ptr %state)
  ret i32 %status
}}
@vibro_initial_state = constant [{state_size} x i8] c"{state}", align 8
"""
KEPT = (ENTRY, CALIBRATE, "vibro_initial_state")
NAMES_EXCEPTION = re.compile(r"^ *store ptr @\.const\.picklebuf\S*, ptr \S*.*\n", re.MULTILINE)
"""Stores of numba's pickled exceptions, which are removed: the wrapper only uses the status."""


def escaped(content: bytes) -> str:
    """Bytes in the notation of LLVM assembly."""
    return "".join(f"\\{byte:02x}" for byte in content)


def kept(name: str, make: Callable[[], bytes]) -> Path:
    """Path of a cached file of what `make` returns, which depends on the firmware's sources alone."""
    return kept_file(folder_of("firmware_py.builds", *BUILDERS), name, make)


def raw_assembly(has_gait: bool = True) -> str:
    """The firmware's LLVM assembly as `raw_ir` writes it; the first time it takes half a minute."""
    return kept(f"raw{variant(has_gait)}.ll", lambda: _raw_assembly(has_gait)).read_text()


def variant(has_gait: bool) -> str:
    """Part of the names of the files."""
    return "" if has_gait else f"-{NO_GAIT}"


def _raw_assembly(has_gait: bool) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        fresh = Path(folder) / "raw.ll"
        command = [sys.executable, "-P", "-m", "firmware_py.builds.raw_ir", str(fresh)]
        command += [] if has_gait else [NO_GAIT]
        subprocess.run(command, env=os.environ | RAW, check=True)
        return fresh.read_bytes()


def object_code(target: TargetName, has_gait: bool = True) -> bytes:
    """The firmware as a relocatable object file; without a gait, the operator alone asks for a ratio."""
    name = f"{target}{variant(has_gait)}.o"
    return kept(name, lambda: _object_code(target, has_gait)).read_bytes()


def _object_code(target: TargetName, has_gait: bool) -> bytes:
    assembly = NAMES_EXCEPTION.sub("", raw_assembly(has_gait))
    state = in_precision(stored(INITIAL), FirmwareState, TARGETS[target].precision).tobytes()
    tick, calibrate = assembly.partition("\n")[0].removeprefix("; ").split()
    wrapper = WRAPPER.format(tick=tick, calibrate=calibrate, state_size=len(state), state=escaped(state))
    return retargeted(assembly + wrapper, TARGETS[target], KEPT)


@contextmanager
def whole_registers() -> Iterator[None]:
    """Keep LLVM's register allocator from splitting live ranges by regions of the code.

    Region splitting, LLVM's default, adds ten to twenty kilobytes of moves to this one large function,
    varying with each change of a line, and saves no instruction per tick. The option is global in the
    process, so it is reset afterwards.
    """
    limit = "-grow-region-complexity-budget="
    llvm.set_option("", f"{limit}0")
    try:
        yield
    finally:
        llvm.set_option("", f"{limit}{LLVM_REGION_BUDGET}")


def retargeted(assembly: str, target: Target, kept_names: Collection[str]) -> bytes:
    """The object file of numba's raw LLVM assembly; only `kept_names` have external linkage."""
    if target.precision == "single":
        assembly = single_precision.narrowed(assembly)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=SPEED, reloc=target.relocation, codemodel="default"
    )
    module = llvm.parse_assembly(assembly)
    module.triple, module.data_layout = target.triple, str(machine.target_data)
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name not in kept_names:
            symbol.linkage = "internal"
    for function in module.functions:
        if function.is_declaration:
            continue
        is_named = any(part in function.name for part in INLINED)
        if is_named or len(list(function.arguments)) > MOST_ARGUMENTS:
            function.add_function_attribute("alwaysinline")
        elif any(part in function.name for part in APART):
            function.add_function_attribute("noinline")
    options = llvm.create_pipeline_tuning_options(speed_level=SPEED)
    options.slp_vectorization = options.loop_vectorization = False
    options.loop_unrolling = False  # unrolling: a tenth more flash, no faster tick
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    with whole_registers():
        return bytes(machine.emit_object(module))


def sizes(target: TargetName, has_gait: bool = True) -> dict[str, int]:
    """Bytes of the target's object file in flash, and of its caller's structs in RAM."""
    code, precision = object_code(target, has_gait), TARGETS[target].precision
    text = constants = 0
    for section in llvm.ObjectFileRef.from_data(code).sections():  # an iterator that reuses one object
        text += section.size() if section.is_text() else 0
        constants += section.size() if (section.name() or b"").startswith(b".rodata") else 0
    records = {"config": Config, "state": FirmwareState, "tx": Tx}
    structs = {name: layout(kind, precision).itemsize for name, kind in records.items()}
    return {"code": text, "constants": constants, **structs}
