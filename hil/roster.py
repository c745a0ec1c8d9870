"""The nodes of the bench, each once, in the order in which they act in a tick.

A node's runner is a class as of `hil.nodes.runner.NodeRunner`. All that lists the nodes iterates over
`ROSTER`: the loop, the pacemaker's plan, the processes and the addressees of faults.
"""

from importlib import import_module
from itertools import groupby, pairwise
from typing import Any, NamedTuple

PLANT, OPERATOR, FIRMWARE = "plant", "operator", "firmware"
AGAIN = "-again"
"""What the name of a process that replaces a restarted one ends with."""


class Node(NamedTuple):
    """A node."""

    name: str
    phase: float
    """Its instant in a tick, as a share of the period."""
    runner: str
    """The class of its runner, as `MODULE:CLASS`."""
    traces: tuple[str, ...]
    """The names of the traces that it may write."""
    is_process: bool = True
    """Whether it has a process of its own in real time, which faults can pause and kill; otherwise it acts in
    the process of the bench, whose end ends the run."""
    has_compiled_turn: bool = False
    """Whether compiled stretches contain its turn; with another node there are none of all nodes."""

    @property
    def makes(self) -> Any:
        """The class of its runner, loaded."""
        module, _, name = self.runner.partition(":")
        return getattr(import_module(module), name)


ROSTER = [
    Node(PLANT, 0.0, "hil.nodes.plant.runner:PlantRunner", ("plant", "impacts"), has_compiled_turn=True),
    Node(
        OPERATOR,
        0.0,
        "hil.nodes.operator.runner:OperatorRunner",
        ("operator",),
        is_process=False,
        has_compiled_turn=True,
    ),
    Node(FIRMWARE, 0.5, "hil.nodes.firmware.runner:FirmwareRunner", ("firmware",), has_compiled_turn=True),
]


class Instant(NamedTuple):
    """An instant of a tick: its beginning, the beginning of the next one, and the nodes that act at it."""

    begin_ns: int
    end_ns: int
    nodes: list[Node]


def instants(period_ns: int) -> list[Instant]:
    """The instants of a tick in order."""
    groups = [(round(phase * period_ns), list(nodes)) for phase, nodes in groupby(ROSTER, lambda n: n.phase)]
    edges_ns = [*(begin_ns for begin_ns, _ in groups), period_ns]
    return [Instant(*edges, nodes) for edges, (_, nodes) in zip(pairwise(edges_ns), groups, strict=True)]


def node_named(name: str) -> Node:
    """The node with this name."""
    return next(node for node in ROSTER if node.name == name)


def names() -> tuple[str, ...]:
    """The names of all nodes."""
    return tuple(node.name for node in ROSTER)


def trace_names() -> tuple[str, ...]:
    """The names of the traces of all nodes."""
    return tuple(name for node in ROSTER for name in node.traces)


def processes() -> tuple[str, ...]:
    """The names of the nodes with a process of their own."""
    return tuple(node.name for node in ROSTER if node.is_process)


def again_name(process: str) -> str:
    """Name of the process that replaces a restarted one."""
    return f"{process}{AGAIN}"


def processes_of_a_run() -> tuple[str, ...]:
    """The names of all processes that a run's nodes may have."""
    return (*processes(), *map(again_name, processes()))


def members() -> tuple[str, ...]:
    """The names of all that take turns in real time: the nodes, and the processes that replace others."""
    return (*names(), *map(again_name, processes()))


def as_choice(choices: tuple[str, ...]) -> str:
    """Names as text: `plant, firmware or operator`."""
    return " or ".join(filter(None, (", ".join(choices[:-1]), choices[-1])))
