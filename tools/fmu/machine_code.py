"""Functions as an object file that a C program calls: numba's unoptimised code, compiled by LLVM alone, and
the memory that they take.

`NUMBA_OPT=0 python -m tools.fmu.machine_code FILE ARGUMENTS` writes the raw assembly of an FMU's
functions; it needs a process of its own, because numba reads NUMBA_OPT only once.
"""

import hashlib
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection
from os import environ
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import types

from compilation.kernel_cache import folder_of, kept_file
from compilation.linking import LINKED
from firmware_py.builds.flat import to_flat
from hil.timing.realtime import collect_rarely

TRIPLE, CPU = "x86_64-unknown-linux-gnu", "x86-64-v2"
"""Every 64-bit PC of the last fifteen years. No fused multiply-add, which would change bits."""
RAW = {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}
"""numba's settings in a process that writes raw assembly; it compiles even where kernels are interpreted."""
SPEED = 2
MOST_ARGUMENTS = 100
"""A function with more arguments is inlined: numba passes each number of a record as an argument."""
NAMES_EXCEPTION = re.compile(r"^ *store ptr @\.const\.picklebuf\S*, ptr \S*.*\n", re.MULTILINE)
"""Stores of numba's pickled exceptions, which are removed: the wrapper only uses the status."""
Functions = dict[str, tuple[Callable[..., int], tuple[Any, ...]]]
"""Functions that return an integer, with numba's types of their arguments, by their names in C."""

OPTIONS: dict[str, Any] = LINKED | {"nogil": True, "error_model": "numpy"}
WRAPPER = """
define i64 @{name}({parameters}) {{
  %returned = alloca i64
  %raised = alloca ptr
  %status = call i32 @{mangled}(ptr %returned, ptr %raised{arguments})
  %ok = icmp eq i32 %status, 0
  %value = load i64, ptr %returned
  %result = select i1 %ok, i64 %value, i64 -1
  ret i64 %result
}}
"""
"""It returns the function's integer, or −1 if its arithmetic raised."""


class Flat(NamedTuple):
    """Words of an instance's memory that hold no array."""

    words: list[int]
    fields: tuple[()] = ()


def flat(record: tuple[Any, ...]) -> Flat:
    """A record of the firmware's subset, as in `firmware_py.builds.flat`."""
    content = to_flat(record).tobytes()
    return Flat(np.frombuffer(content.ljust(-(-len(content) // 8) * 8, b"\0"), np.int64).tolist())


def assembly(functions: Functions) -> str:
    """The raw LLVM assembly of these functions and of all that they call."""
    linked, wrappers = llvm.parse_assembly(""), []
    for name, (function, kinds) in functions.items():
        result = next(iter(numba.njit(types.int64(*kinds), **OPTIONS)(function).overloads.values()))
        linked.link_in(llvm.parse_assembly(NAMES_EXCEPTION.sub("", result.library.get_llvm_str())))
        passed = [f"{'double' if kind == types.float64 else 'ptr'} %a{i}" for i, kind in enumerate(kinds)]
        wrappers.append(
            WRAPPER.format(
                name=name,
                mangled=result.fndesc.mangled_name,
                parameters=", ".join(passed),
                arguments="".join(f", {one}" for one in passed),
            )
        )
    return str(linked) + "".join(wrappers)


def main() -> None:
    """Write the file."""
    collect_rarely()
    from tools.fmu.models import functions_of

    file, *arguments = sys.argv[1:]
    Path(file).write_text(assembly(functions_of(*arguments)))


def object_code(arguments: tuple[str, ...], names: Collection[str]) -> bytes:
    """The object file of the functions `names` of a model; the first time it takes half a minute."""

    def make() -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            fresh = Path(folder) / "raw.ll"
            command = [sys.executable, "-P", "-m", "tools.fmu.machine_code", str(fresh), *arguments]
            subprocess.run(command, env=environ | RAW, check=True)
            return object_of(fresh.read_text(), names)

    digest = hashlib.sha256("\0".join(arguments).encode()).hexdigest()[:16]
    folder = folder_of("tools.fmu")
    return kept_file(folder, f"{digest}.o", make).read_bytes()


def object_of(raw: str, kept_names: Collection[str]) -> bytes:
    """The object file of raw assembly; only `kept_names` have external linkage."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(cpu=CPU, opt=SPEED, reloc="pic", codemodel="default")
    module = llvm.parse_assembly(raw)
    module.triple, module.data_layout = TRIPLE, str(machine.target_data)
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name not in kept_names:
            symbol.linkage = "internal"
    for function in module.functions:
        if not function.is_declaration and len(list(function.arguments)) > MOST_ARGUMENTS:
            function.add_function_attribute("alwaysinline")
    options = llvm.create_pipeline_tuning_options(speed_level=SPEED)
    options.slp_vectorization = options.loop_vectorization = options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


if __name__ == "__main__":
    main()
