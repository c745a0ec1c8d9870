"""What compiled code needs to call a node's firmware itself: the nodes of `NativeNode` hold it."""

from abc import abstractmethod
from typing import NamedTuple

from firmware_py.builds.flat import Memory, Precision
from firmware_py.shell.flat_node import FlatNode


class Native(NamedTuple):
    """A C function of this process, by its address, and the memory that it works on.

    It returns `done` where its arithmetic has not failed.
    """

    tick: int
    done: int
    config: Memory
    state: Memory
    precision: Precision


class NativeNode(FlatNode):
    """A node whose tick runs in this process."""

    @property
    @abstractmethod
    def native(self) -> Native:
        """Its function and memory; the memory is another one after `changed`."""

    @abstractmethod
    def ticked(self) -> None:
        """Its function has been called from elsewhere: bring `memory` up to date."""
