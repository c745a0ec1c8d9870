"""The bus of lockstep: at once, or as the bus model says where a scenario asks for it."""

from typing import Protocol

from firmware_py.interface.frame import Frame
from hil.bus.in_process import InProcessBus, InProcessNode
from hil.bus_model.in_process import ModelledInProcessBus
from hil.nodes import NodeBus

PLANT, FIRMWARE, OPERATOR = NODES = ("plant", "firmware", "operator")

Logged = tuple[int, list[Frame]]
"""Frames and their common time in ns."""


class LockstepBus(Protocol):
    """Nodes join it by name; between their turns time passes."""

    def join(self, name: str) -> NodeBus:
        """The connection of one of the nodes."""

    def pass_time(self, from_ns: int, to_ns: int) -> list[Logged]:
        """Let time pass; gives what was on the bus meanwhile, for the log."""


class BusAtOnce:
    """What a node sends has arrived."""

    def __init__(self) -> None:
        self._bus = InProcessBus()
        self._log = self._bus.join()

    def join(self, name: str) -> InProcessNode:
        """The connection of one of the nodes; an operator only speaks."""
        return self._bus.join(listening=name != OPERATOR)

    def pass_time(self, from_ns: int, to_ns: int) -> list[Logged]:
        """Frames are logged when they are sent."""
        return [(from_ns, self._log.receive())]


class BusAsModelled:
    """Frames take their time, the lowest identifier first; `model` takes the bus's own faults."""

    def __init__(self, bitrate: int) -> None:
        self._bus = ModelledInProcessBus(NODES, bitrate)
        self.model = self._bus.model

    def join(self, name: str) -> NodeBus:
        """The connection of one of the nodes."""
        return self._bus.join(name)

    def pass_time(self, from_ns: int, to_ns: int) -> list[Logged]:
        """Frames are logged when they have arrived."""
        return [(delivery.t_ns, [delivery.frame]) for delivery in self._bus.move_to(to_ns)]
