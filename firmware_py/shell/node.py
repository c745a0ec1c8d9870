"""The firmware on the bus: `firmware_py.node` with bytes around its words. No clock, no socket."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.config import Config, config_of
from firmware_py.core.inputs import Inputs
from firmware_py.core.state import Outputs, State
from firmware_py.interface.arrivals import Counters
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.zeroed import Record
from firmware_py.node import calibration, inbox, memory, xcp
from firmware_py.node.tick import INITIAL, tick
from firmware_py.shell.parameters import ParameterError, parameters_of, parse_file, values_of, with_overrides


class Node(ABC):
    """One controller of any build; its `tick` is called once per control period.

    `inputs`, `state` and `outputs` belong to the newest tick; `counters` count since power-up.
    """

    memory: NDArray[np.void] | None = None
    """The whole `NodeState` as one element of flat memory, if the build uses flat memory; else None."""
    pool: list[int]
    """The memory of the XCP slave (`firmware_py.node.xcp`)."""
    elapsed_ticks: int = 0
    """Periods since the previous call of `tick`, as of the last one."""
    damage: str = ""
    """The reason for which the parameter file was refused at power-up; empty if it was accepted."""

    def __init__(self, config: Config) -> None:
        self.config = config

    @abstractmethod
    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""

    @property
    @abstractmethod
    def inbox(self) -> list[int]:
        """The memory of the waiting frames (`firmware_py.node.inbox`)."""

    @abstractmethod
    def receive(self, frames: Sequence[Frame]) -> None:
        """Put frames into the inbox in the order of their arrival."""

    @abstractmethod
    def advance(self, elapsed_ticks: int) -> int:
        """Let time pass; the number of periods to run."""

    @abstractmethod
    def run_period(self) -> list[Frame]:
        """Run one control period."""

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run every period since the last call, each on its own frames, and return what is to be sent.

        `elapsed_ticks` exceeds 1 after missed periods; only the torque of the last one is sent.
        """
        if elapsed_ticks < 1:
            raise ValueError(f"elapsed_ticks = {elapsed_ticks}; a tick is later than the one before it")
        self.elapsed_ticks = elapsed_ticks
        self.receive(frames_in)
        sent: list[Frame] = []
        for _ in range(self.advance(elapsed_ticks)):
            self.calibrate()
            sent += self.run_period()
        return sent

    def calibrate(self) -> bool:
        """Judge the waiting request of XCP, if there is one; a commit changes `config`."""
        if self.pool[xcp.REQUEST] == xcp.NO_REQUEST:
            return False
        self.config = calibration.calibrate(self.pool, self.config, self.outputs.mode)
        return True

    @property
    @abstractmethod
    def ticks(self) -> int:
        """The number of periods since power-up."""

    @property
    def values(self) -> dict[str, float]:
        """The parameters in use, by their dotted names."""
        return values_of(self.config.p)

    @property
    def inputs(self) -> Inputs:
        """The core's inputs of the newest tick."""
        return self.part(Inputs, "inputs")

    @property
    def state(self) -> State:
        """The core's state after the newest tick."""
        return self.part(State, "core")

    @property
    def outputs(self) -> Outputs:
        """The core's outputs of the newest tick."""
        return self.part(Outputs, "outputs")

    @property
    def counters(self) -> Counters:
        """Frames accepted, dropped and lost since power-up."""
        return self.part(Counters, "counters")


MakeNode = Callable[[Config], Node]
"""A function or class that makes a controller after power-up."""


class FirmwareNode(Node):
    """A node whose firmware is interpreted."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._state, self.pool = INITIAL, memory.pool_of(self.values.values())
        self._inbox = [0] * inbox.SIZE
        import filterpy.kalman  # noqa: F401, PLC0415 - now, not in the first tick: it takes a second

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = getattr(self._state, name)
        return record

    @property
    def ticks(self) -> int:
        """The number of periods since power-up."""
        return self._state.ticks

    @property
    def inbox(self) -> list[int]:
        """The memory of the waiting frames."""
        return self._inbox

    def receive(self, frames: Sequence[Frame]) -> None:
        """Put frames into the inbox in the order of their arrival."""
        for can_id, data in frames:
            inbox.receive(self._inbox, WordFrame(can_id, len(data), word_of(data)))

    def advance(self, elapsed_ticks: int) -> int:
        """Let time pass; the number of periods to run."""
        newest, most_ticks = self._state.received.accelerometer_arrival, self.config.catch_up_ticks
        return inbox.advance(self._inbox, newest, self._state.ticks, elapsed_ticks, most_ticks)

    def run_period(self) -> list[Frame]:
        """Run one control period."""
        self._state, tx = tick(self.config, self._state, self._inbox)
        inbox.end_period(self._inbox)
        tx = xcp.exchange(self.pool, self._state, self.config.tick_s, self._state, tx)
        sent = (tx.first, tx.second, tx.third)[: tx.frame_count]
        return [Frame(can_id, bytes_of(word, length)) for can_id, length, word in sent]


class PoweredUp(Protocol):
    """What `power_up` makes."""

    damage: str
    """The reason for which the parameter file was refused; empty if it was accepted."""


AnyNode = TypeVar("AnyNode", bound=PoweredUp)


def power_up(
    parameter_file: str,
    build: Mapping[str, float] | None = None,
    make: Callable[[Config], AnyNode] = FirmwareNode,  # type: ignore[assignment]  # a default narrows no TypeVar
) -> AnyNode:
    """A controller that starts with the content of its parameter file and the parameters of its build.

    If the file is damaged, the controller uses default parameters, reports PARAMETERS_DAMAGED on the bus and
    does not arm; its `damage` says what is wrong with the file.
    """
    try:
        config = config_in(parameter_file, tuple((build or {}).items()))
    except ParameterError as error:
        node = make(config_of(parameters_of(with_overrides(build or {})), True))
        node.damage = str(error)
        return node
    return make(config)


@lru_cache(maxsize=64)
def config_in(parameter_file: str, build: tuple[tuple[str, float], ...]) -> Config:
    """The configuration of a parameter file and the parameters of the build, kept for many runs of one."""
    return config_of(parameters_of(parse_file(parameter_file, dict(build))), False)
