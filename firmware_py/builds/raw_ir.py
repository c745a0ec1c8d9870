"""`NUMBA_OPT=0 python -m firmware_py.builds.raw_ir FILE`: the firmware as numba passes it to LLVM.

Writes the LLVM assembly of `flat_tick` and of all functions that it calls, not optimised, to FILE; the first
line is a comment with the function's name. It needs its own process, because numba reads NUMBA_OPT only once.
"""

import sys
from pathlib import Path
from typing import Any

import numba

from firmware_py.builds.flat_tick import SIGNATURE, flat_tick
from firmware_py.builds.numba_subset import register


def main() -> None:
    """Write the file."""
    register(inlined=False)
    dispatcher = numba.njit(SIGNATURE)(flat_tick)
    result: Any = next(iter(dispatcher.overloads.values()))
    text = result.library.get_llvm_str()
    Path(sys.argv[1]).write_text(f"; {result.fndesc.mangled_name}\n{text}")


if __name__ == "__main__":
    main()
