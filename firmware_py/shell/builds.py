"""The builds of the firmware's one source, by name."""

from typing import Literal

from firmware_py.shell.node import FirmwareNode, MakeNode

Build = Literal["python", "compiled", "host-single", "cortex-m7", "cortex-m4f"]
"""`python`: interpreted, with filterpy's algebra. `compiled`: numba's code behind one C function.
`host-single`: the same in single precision. `cortex-m7` and `cortex-m4f`: the code of `compiled` and of
`host-single` for a Cortex-M7 and a Cortex-M4F, on a board that QEMU emulates, in lockstep alone."""
NATIVE: tuple[Build, ...] = ("compiled", "host-single")
"""Builds whose nodes are of `native.NativeNode`: compiled code can call them."""


def node_of(build: Build) -> MakeNode:
    """What makes a node of this build; the first of a process compiles it, or takes it from the cache."""
    if build == "python":
        return FirmwareNode
    if build in ("cortex-m7", "cortex-m4f"):
        from firmware_py.shell import board_node  # noqa: PLC0415 - imports LLVM

        return board_node.BoardNode if build == "cortex-m7" else board_node.SinglePrecisionBoardNode
    if build == "host-single":
        from firmware_py.shell.single_node import SingleNode  # noqa: PLC0415 - imports LLVM

        return SingleNode
    from firmware_py.shell.compiled_node import CompiledNode  # noqa: PLC0415 - imports numba

    return CompiledNode
