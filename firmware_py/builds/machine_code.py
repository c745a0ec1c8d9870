"""The firmware as an object file for any target: numba's unoptimised code, compiled by LLVM alone.

    void vibro_power_up(vibro_firmware_state *)
    int32_t vibro_receive(vibro_firmware_state *, int64_t frame_count, const vibro_word_frame *)
    int32_t vibro_advance(const vibro_config *, vibro_firmware_state *, int64_t elapsed_ticks)
    int32_t vibro_tick(const vibro_config *, vibro_firmware_state *, vibro_tx *)
    int32_t vibro_calibrate(vibro_config *, vibro_firmware_state *)

`vibro_advance` returns the number of ticks to run, the others 0; `vibro_tick` returns another number with
state and tx unchanged if the arithmetic failed. The object requires functions for operations without an
instruction on its target and for copying and filling memory, but no operating system and no inexact
mathematics of a C library, whose last bits differ from another's.
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
import numpy as np

from compilation.kernel_cache import folder_of, kept_file
from firmware_py.builds import single_precision
from firmware_py.builds.flat import Precision, layout, to_flat, to_precision
from firmware_py.core.config import Config
from firmware_py.node.memory import INITIAL, FirmwareState
from firmware_py.node.tick import Tx

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
    is_small: bool
    """Whether the code is made for little flash rather than for speed alone."""


_ARM = "thumbv7em-none-unknown-eabihf"
TARGETS: dict[TargetName, Target] = {
    "cortex-m7": Target(_ARM, "cortex-m7", "+fp-armv8d16,+fp64", "static", "double", is_small=True),
    "cortex-m4f": Target(_ARM, "cortex-m4", "+vfp4d16sp,-fp64", "static", "single", is_small=True),
    "host": Target(llvm.get_default_triple(), "", "", "pic", "double", is_small=False),
    "host-single": Target(llvm.get_default_triple(), "", "", "pic", "single", is_small=False),
}
"""The host's features are not used: a fused multiply-add that another target lacks would change bits."""

ENTRIES = ("vibro_power_up", "vibro_receive", "vibro_advance", "vibro_tick", "vibro_calibrate")
GAIT_CONSTANT = "vibro_has_gait"
"""A constant array of one byte in the raw assembly, which is 1: LLVM leaves out the gait where it is 0."""
HAS_GAIT = re.compile(rf'^(@{GAIT_CONSTANT}\S* = .* \[1 x i8\] )c"\\01"', re.MULTILINE)
RAW = {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}
"""Numba's settings in a process that writes raw assembly; it compiles even where kernels are interpreted."""
SPEED = 2
LLVM_REGION_BUDGET = 10_000
"""LLVM's default of the limit that `code_generation` sets."""
MOST_ARGUMENTS = 100
"""A function with more arguments is inlined: numba passes each number of a record as an argument of its own,
and LLVM cannot compile a call with kilobytes of arguments for ARM."""
INLINED = ("9interface7framing", "12replacements10_with_page")
"""Parts of mangled names. These functions are inlined too: frame lengths become constants, and of all the
parameters only those are copied that a commit checks."""
APART = ("4node3xcp5serve", "12replacements8put_page")
"""Parts of mangled names. These functions, which a tick seldom or never calls, are not inlined."""
QUICK = ("vibro_latch",)
"""Names of functions that stay quick where code is made small: a loop over the measurements of a sample."""
WRAPPER = """
define i32 @vibro_receive(ptr %state, i64 %count, ptr %frames) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{receive}(ptr %returned, ptr %raised, ptr %state, i64 %count, ptr %frames)
  ret i32 %status
}}
define i32 @vibro_advance(ptr %config, ptr %state, i64 %elapsed) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{advance}(ptr %returned, ptr %raised, ptr %config, ptr %state, i64 %elapsed)
  %periods = load i64, ptr %returned
  %periods.word = trunc i64 %periods to i32
  ret i32 %periods.word
}}
define i32 @vibro_tick(ptr %config, ptr %state, ptr %tx) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{tick}(ptr %returned, ptr %raised, ptr %config, ptr %state, ptr %tx)
  ret i32 %status
}}
define i32 @vibro_calibrate(ptr %config, ptr %state) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{calibrate}(ptr %returned, ptr %raised, ptr %config, ptr %state)
  ret i32 %status
}}
@places = internal constant [{count} x i16] [{places}]
@words = internal constant [{count} x i32] [{words}]
define void @vibro_power_up(ptr %state) {{
begin:
  call void @llvm.memset.p0.i32(ptr align 8 %state, i8 0, i32 {state_size}, i1 false)
  br label %next
next:
  %index = phi i32 [ 0, %begin ], [ %following, %next ]
  %place.pointer = getelementptr i16, ptr @places, i32 %index
  %place = load i16, ptr %place.pointer
  %place.wide = zext i16 %place to i32
  %word.pointer = getelementptr i32, ptr @words, i32 %index
  %word = load i32, ptr %word.pointer
  %target = getelementptr i32, ptr %state, i32 %place.wide
  store i32 %word, ptr %target
  %following = add i32 %index, 1
  %is.last = icmp eq i32 %following, {count}
  br i1 %is.last, label %end, label %next
end:
  ret void
}}
declare void @llvm.memset.p0.i32(ptr, i8, i32, i1)
"""
"""`vibro_power_up` fills the state from its words that are not 0, a fifth of all, to save flash."""
TO_INTEGER = re.compile(r"^ *(%\S+) = fptosi double (\S+) to i64", re.MULTILINE)
"""Conversions of floats to integers. All of the firmware's are within 32 bits, for which processors have an
instruction (`tests/firmware_py/node/test_conversions.py`); for 64 they call a function of the C library,
which on a Cortex-M4F uses doubles. The pattern begins at the beginning of a line: from within a line it would
scan each long name once per character."""
NAMES_EXCEPTION = re.compile(r"^ *store ptr @\.const\.picklebuf\S*, ptr \S*.*\n", re.MULTILINE)
"""Stores of numba's pickled exceptions, which are removed: the wrapper only uses the status."""
RESULT = re.compile(r"call i32 @[^\n(]*\(ptr (%\S+), ptr ")
"""A call of a function of numba's: its first argument is the memory of its result."""
ZEROED = re.compile(
    r"^ *store .* (?:zeroinitializer|false|0|0\.0+e\+00), ptr (%\S+), align \d+\n", re.MULTILINE
)


def cache_file(name: str, make: Callable[[], bytes]) -> Path:
    """Path of a cached file of what `make` returns, which depends on the firmware's sources alone."""
    return kept_file(folder_of("firmware_py.builds"), name, make)


def raw_assembly() -> str:
    """The firmware's LLVM assembly as `raw_ir` writes it; the first time it takes some 15 s."""
    return cache_file("raw.ll", _raw_assembly).read_text()


def _raw_assembly() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        fresh = Path(folder) / "raw.ll"
        command = [sys.executable, "-P", "-m", "firmware_py.builds.raw_ir", str(fresh)]
        subprocess.run(command, env=os.environ | RAW, check=True)
        return fresh.read_bytes()


def object_code(target: TargetName, has_gait: bool = True) -> bytes:
    """The firmware as a relocatable object file; without a gait, the operator alone asks for a ratio."""
    name = target if has_gait else f"{target}-without-gait"
    return cache_file(f"{name}.o", lambda: _object_code(target, has_gait)).read_bytes()


def _object_code(target: TargetName, has_gait: bool) -> bytes:
    assembly = remove_zeroed_results(NAMES_EXCEPTION.sub("", raw_assembly()))
    assembly = TO_INTEGER.sub(
        r"  \1.word = fptosi double \2 to i32\n  \1 = sext i32 \1.word to i64", assembly
    )
    assembly, constants = HAS_GAIT.subn(rf'\1c"\\0{has_gait:d}"', assembly)
    assert constants > 0, "the raw assembly lacks the constant that leaves out the gait"
    receive, advance, tick, calibrate = assembly.partition("\n")[0].removeprefix("; ").split()
    state = to_precision(to_flat(INITIAL), FirmwareState, TARGETS[target].precision)
    words = np.frombuffer(state.tobytes(), "<u4")
    (places,) = words.nonzero()
    wrapper = WRAPPER.format(
        receive=receive,
        advance=advance,
        tick=tick,
        calibrate=calibrate,
        state_size=words.nbytes,
        count=places.size,
        places=", ".join(f"i16 {place}" for place in places),
        words=", ".join(f"i32 {word}" for word in words[places]),
    )
    return retarget(assembly + wrapper, TARGETS[target], ENTRIES)


def remove_zeroed_results(assembly: str) -> str:
    """The assembly without the zeros that numba stores into the memory of a call's result beforehand.

    The result counts only if the call succeeds. After a call that fails, LLVM would carry on these zeros
    beside the values of a call that succeeds: moves of each number of a record, 6 kB of code in all.
    """

    def keep(function: str) -> str:
        results = set(RESULT.findall(function))
        return ZEROED.sub(lambda store: "" if store[1] in results else store[0], function)

    return "\n}\n".join(map(keep, assembly.split("\n}\n")))


@contextmanager
def code_generation() -> Iterator[None]:
    """Set LLVM's option for the generation of machine code, which is global in the process.

    Its register allocator does not split live ranges by regions of the code: this default adds five kilobytes
    of moves to this one large function, varying with each change of a line, and no tick is quicker.
    """
    option = "-grow-region-complexity-budget="
    llvm.set_option("", f"{option}0")
    try:
        yield
    finally:
        llvm.set_option("", f"{option}{LLVM_REGION_BUDGET}")


def retarget(assembly: str, target: Target, kept_names: Collection[str]) -> bytes:
    """The object file of numba's raw LLVM assembly; only `kept_names` have external linkage."""
    if target.precision == "single":
        assembly = single_precision.narrow(assembly)
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
    # Not before the passes above: they would inline less.
    for function in module.functions:
        if target.is_small and not function.is_declaration and function.name not in QUICK:
            function.add_function_attribute("minsize")
            function.add_function_attribute("optsize")
    with code_generation():
        return bytes(machine.emit_object(module))


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
