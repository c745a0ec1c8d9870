"""The compiled code of a scene's kernel, and what stands in it."""

import struct
from typing import Any

from changed_scenes import changed
from numba import typeof

from plant_sim.plant import Plant, compiled_advance
from plant_sim.scene import load_scene
from plant_sim.solvers.adaptive.adaptive import advance


def kernel_code(changes: dict[str, Any]) -> str:
    """The compiled code of a scene's kernel, as LLVM writes it down."""
    plant = Plant(load_scene(changed("table1-viscous", changes)), seed=1)
    compiled_advance(plant)
    for signature, kernel in advance.overloads.items():  # type: ignore[attr-defined]
        if [str(kind) for kind in signature[:2]] == [str(typeof(plant.parts)), str(typeof(plant._probe))]:
            # The code that is linked into callers; unlike `inspect_llvm`, it is kept in the cache too.
            return str(kernel.library._get_module_for_linking())
    raise AssertionError


def has_exponential(code: str) -> bool:
    return "@exp(" in code or "@llvm.exp.f64(" in code


def arithmetic(code: str) -> int:
    """How many floating-point operations are written in it."""
    return sum(code.count(f" {operation} ") for operation in ("fadd", "fsub", "fmul", "fdiv"))


def calls(code: str, function: str) -> int:
    """How often a function of one number is mentioned in it."""
    return code.count(f"@llvm.{function}.f64(") + code.count(f"@{function}(")


def constant(value: float) -> str:
    """A number as LLVM writes it within an array."""
    return "".join(
        chr(byte) if 32 <= byte < 127 and byte not in b'"\\' else f"\\{byte:02X}"
        for byte in struct.pack("<d", value)
    )
