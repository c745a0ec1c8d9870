"""Nodes whose firmware compiled code can call directly, by address."""

from abc import abstractmethod
from typing import NamedTuple

from firmware_py.builds.flat import Memory, Precision
from firmware_py.shell.flat_node import FlatNode


class Native(NamedTuple):
    """The address of a C function in this process, and the memory on which it works.

    The function returns `success` unless its arithmetic has failed.
    """

    tick_address: int
    success: int
    config: Memory
    state: Memory
    precision: Precision


class NativeNode(FlatNode):
    """A node whose tick runs in this process."""

    @property
    @abstractmethod
    def native(self) -> Native:
        """The node's function and memory; `push_memory` may replace the memory."""

    @abstractmethod
    def pull_state(self) -> None:
        """Update `memory` after other code has called the function."""
