"""The builds of the firmware's one source, by name."""

from typing import Literal

from firmware_py.shell.node import FirmwareNode, MakeNode

Build = Literal["python", "compiled", "cortex-m7", "cortex-m4f"]
"""`python`: interpreted, with filterpy's algebra. `compiled`: numba's code behind one C function.
`cortex-m7`: the same code for a Cortex-M7, on a board that QEMU emulates, in lockstep alone; `cortex-m4f`: in
single precision for a Cortex-M4F."""


def node_of(build: Build) -> MakeNode:
    """What makes a node of this build; the first of a process compiles it, or takes it from the cache."""
    if build == "python":
        return FirmwareNode
    if build in ("cortex-m7", "cortex-m4f"):
        from firmware_py.shell import board_node  # noqa: PLC0415 - imports LLVM

        return board_node.BoardNode if build == "cortex-m7" else board_node.SinglePrecisionBoardNode
    from firmware_py.shell.compiled_node import CompiledNode  # noqa: PLC0415 - imports numba

    return CompiledNode
