"""The nodes of the bench, each once, in the order in which they act in a tick.

A node's module has `make_NAME`, which makes its runner from a `hil.nodes.runners.Making`. All that lists the
nodes iterates over `ROSTER`: the loop, the pacemaker's plan, the processes and the addressees of faults.
"""

from importlib import import_module
from typing import Any, NamedTuple

PLANT, OPERATOR, FIRMWARE = "plant", "operator", "firmware"
AGAIN = "-again"
"""What the name of a process that replaces a restarted one ends with."""


class Node(NamedTuple):
    """A node."""

    name: str
    phase: float
    """Its instant in a tick, as a share of the period."""
    module: str
    is_process: bool = True
    """Whether it has a process of its own in real time, which faults can pause and kill."""
    has_compiled_turn: bool = False
    """Whether compiled stretches contain its turn; with another node there are none of all nodes."""

    def make(self, making: Any) -> Any:
        """Its runner for a run."""
        return getattr(import_module(self.module), f"make_{self.name}")(making)


ROSTER = [
    Node(PLANT, 0.0, "hil.nodes.runners", has_compiled_turn=True),
    Node(OPERATOR, 0.0, "hil.nodes.runners", is_process=False, has_compiled_turn=True),
    Node(FIRMWARE, 0.5, "hil.nodes.own_controller", has_compiled_turn=True),
]


def names() -> tuple[str, ...]:
    """The names of all nodes."""
    return tuple(node.name for node in ROSTER)


def processes() -> tuple[str, ...]:
    """The names of the nodes with a process of their own."""
    return tuple(node.name for node in ROSTER if node.is_process)


def again_name(process: str) -> str:
    """Name of the process that replaces a restarted one."""
    return f"{process}{AGAIN}"


def processes_of_a_run() -> tuple[str, ...]:
    """The names of all processes that a run's nodes may have."""
    return (*processes(), *map(again_name, processes()))


def as_choice(choices: tuple[str, ...]) -> str:
    """Names as text: `plant, firmware or operator`."""
    return " or ".join(filter(None, (", ".join(choices[:-1]), choices[-1])))
