"""`NUMBA_OPT=0 python -m firmware_py.builds.raw_ir FILE`: the firmware as numba passes it to LLVM.

Writes the LLVM assembly of the `FUNCTIONS` of `flat_tick` and of all functions that they call, not optimised,
to FILE; the first line is a comment with their names in the assembly, in the same order. It needs its own
process, because numba reads NUMBA_OPT only once.
"""

import gc
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba

from compilation.linking import LINKED
from firmware_py.builds.flat_tick import FUNCTIONS
from firmware_py.builds.numba_subset import register


def main() -> None:
    """Write the file."""
    gc.set_threshold(50_000)  # collections among numba's many objects take an eighth of the time
    register(inlined=False)
    dispatchers = [numba.njit(signature, **LINKED)(function) for function, signature in FUNCTIONS.values()]
    results: list[Any] = [next(iter(one.overloads.values())) for one in dispatchers]
    first, *others = (llvm.parse_assembly(one.library.get_llvm_str()) for one in results)
    for other in others:
        first.link_in(other)
    names = " ".join(one.fndesc.mangled_name for one in results)
    Path(sys.argv[1]).write_text(f"; {names}\n{first}")


if __name__ == "__main__":
    main()
