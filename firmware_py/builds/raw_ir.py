"""`NUMBA_OPT=0 python -m firmware_py.builds.raw_ir FILE`: the firmware as numba passes it to LLVM.

Writes the LLVM assembly of `flat_tick`, `flat_calibrate` and all functions that they call, not optimised, to
FILE; the first line is a comment with the names of these two. It needs its own process, because numba reads
NUMBA_OPT only once.
"""

import gc
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba

from firmware_py.builds.flat_tick import CALIBRATE_SIGNATURE, SIGNATURE, flat_calibrate, flat_tick
from firmware_py.builds.numba_subset import register
from numba_linking import LINKED


def main() -> None:
    """Write the file."""
    gc.set_threshold(50_000)  # collections among numba's many objects take an eighth of the time
    register(inlined=False)
    functions = ((SIGNATURE, flat_tick), (CALIBRATE_SIGNATURE, flat_calibrate))
    dispatchers = [numba.njit(signature, **LINKED)(function) for signature, function in functions]
    results: list[Any] = [next(iter(one.overloads.values())) for one in dispatchers]
    first, second = (llvm.parse_assembly(one.library.get_llvm_str()) for one in results)
    first.link_in(second)
    names = " ".join(one.fndesc.mangled_name for one in results)
    Path(sys.argv[1]).write_text(f"; {names}\n{first}")


if __name__ == "__main__":
    main()
