"""The firmware on the bus: `firmware_py.node.tick` with bytes around its words. No clock, no socket."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.configure import config_of
from firmware_py.core.estimation.kalman import filterpy_filter
from firmware_py.core.inputs import Inputs
from firmware_py.core.records import Record
from firmware_py.core.state import Config, Outputs, State
from firmware_py.interface.counters import Counters
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.node.tick import INITIAL, MAX_RX, Rx, served, tick
from firmware_py.shell.parameters import ParameterError, parameters_of, read_back, with_overrides


class Node(ABC):
    """One controller of any build; its `tick` is called once per control period.

    `inputs`, `state` and `outputs` belong to the newest tick; `counters` count since power-up.
    """

    memory: NDArray[np.void] | None = None
    """The whole `NodeState` as one element of flat memory, if the build uses flat memory; else None."""
    damage: str = ""
    """The reason for which the parameter file was refused at power-up; empty if it was accepted."""

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        self.config = config
        self.parameters = parameters_of(with_overrides(parameters or {}))

    @abstractmethod
    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""

    @abstractmethod
    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick on the `fitting` frames; `elapsed_ticks` exceeds 1 after skipped ticks."""

    @property
    def can_ids(self) -> Collection[int]:
        """The identifiers that the firmware receives."""
        return RECEIVED_IDS

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


class MakeNode(Protocol):
    """A function or class that makes a controller after power-up."""

    def __call__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> Node:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""


class FirmwareNode(Node):
    """A node whose firmware is interpreted."""

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        super().__init__(config, parameters)
        self._state = INITIAL
        filterpy_filter()  # imports filterpy now, not in the first tick

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = getattr(self._state, name)
        return record

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick on the `fitting` frames; `elapsed_ticks` exceeds 1 after skipped ticks."""
        refuse_other_elapsed(elapsed_ticks)
        if self._state.requests.number > 0:
            self.parameters, self.config, self._state = served(self.parameters, self.config, self._state)
        frames = [WordFrame(can_id, len(data), word_of(data)) for can_id, data in fitting(frames_in)]
        self._state, tx = tick(self.config, self._state, Rx(elapsed_ticks, len(frames), frames))
        torque = Frame(tx.torque.can_id, bytes_of(tx.torque.word, tx.torque.length))
        if tx.frame_count == 1:
            return [torque]
        return [torque, Frame(tx.other.can_id, bytes_of(tx.other.word, tx.other.length))]


def fitting(frames: Sequence[Frame]) -> Sequence[Frame]:
    """The frames that a receive queue of `MAX_RX` keeps: the newest ones and the last of each identifier.

    An E-stop that is sent once, at the beginning of a long overrun, is therefore obeyed afterwards.
    """
    if len(frames) <= MAX_RX:
        return frames
    last = {frame[0]: place for place, frame in enumerate(frames) if frame[0] in RECEIVED_IDS}
    kept = set(last.values())
    others = [place for place in range(len(frames)) if place not in kept]
    kept.update(others[len(kept) - MAX_RX :])
    return [frames[place] for place in sorted(kept)]


def refuse_other_elapsed(elapsed_ticks: int) -> None:
    """Raise ValueError if a tick is not later than the previous one."""
    if elapsed_ticks < 1:
        raise ValueError(f"elapsed_ticks = {elapsed_ticks}; a tick comes at least one tick after the last")


def powered_up(
    parameter_file: str, build: Mapping[str, float] | None = None, make: MakeNode = FirmwareNode
) -> Node:
    """A controller that starts with the content of its parameter file and the parameters of its build.

    If the file is damaged, the controller uses default parameters, reports PARAMETERS_DAMAGED on the bus and
    does not arm; its `damage` says what is wrong with the file.
    """
    try:
        values = read_back(parameter_file, build)
    except ParameterError as error:
        node = make(config_of(parameters_of(with_overrides(build or {})), True), build)
        node.damage = str(error)
        return node
    return make(config_of(parameters_of(values), False), values)
