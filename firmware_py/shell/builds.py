"""The builds of the firmware's one source, by name."""

from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from firmware_py.shell.node import MakeNode

HostBuild = Literal["python", "compiled", "host-single"]
"""The builds that run on this machine, and so in real time."""
Build = Literal[HostBuild, "cortex-m7", "cortex-m4f"]
"""`python`: interpreted, with filterpy's algebra. `compiled`: compiled by numba for this machine. The others
are the emitted C (`builds.c99`): `host-single` in single precision on this machine, `cortex-m7` and
`cortex-m4f` on a board emulated by QEMU, in lockstep only."""
HERE: dict[Build, Build] = {"cortex-m7": "compiled", "cortex-m4f": "host-single"}
"""For each board, the build on this machine that computes the same numbers."""
NATIVE: tuple[Build, ...] = ("compiled", "host-single")
"""Builds whose nodes are instances of `native.NativeNode`, which compiled code can call."""


def is_build(name: str) -> bool:
    """Whether a build has this name."""
    return name in get_args(Build)


def node_of(build: Build) -> "MakeNode":
    """The class of this build's nodes; its first use in a process compiles it or loads it from the cache."""
    if build == "python":
        from firmware_py.shell.node import FirmwareNode  # noqa: PLC0415 - the names of the builds need less

        return FirmwareNode
    if build in ("cortex-m7", "cortex-m4f"):
        from firmware_py.shell import board_node  # noqa: PLC0415 - imports the emitter

        return board_node.BoardNode if build == "cortex-m7" else board_node.SinglePrecisionBoardNode
    from firmware_py.shell import native  # noqa: PLC0415 - only where it runs

    return native.NativeNode if build == "compiled" else native.SinglePrecisionNode
