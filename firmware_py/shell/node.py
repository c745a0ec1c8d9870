"""The firmware on the bus: `firmware_py.node.tick` with bytes around its words. No clock, no socket."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.config import Config
from firmware_py.core.configure import config_of
from firmware_py.core.inputs import Inputs
from firmware_py.core.state import Outputs, State
from firmware_py.interface.arrivals import Counters
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.generated.kinds import SET_INPUT_TORQUE
from firmware_py.interface.generated.received import Received
from firmware_py.interface.zeroed import Record
from firmware_py.node import calibration, memory, xcp
from firmware_py.node.tick import INITIAL, Rx, tick
from firmware_py.shell.catching_up import divide_frames, due_counter, fit_frames
from firmware_py.shell.parameters import ParameterError, parameters_of, parse_file, values_of, with_overrides

LONGEST_CATCH_UP_S = 0.5
"""Longer than the watchdogs of links and sensors (`ceiling.link_watchdog_s`): raise both together."""


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

    @abstractmethod
    def run_period(self, frames: Sequence[Frame], behind_ticks: int) -> list[Frame]:
        """Run one control period, `behind_ticks` before the present one."""

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run every period since the last call, each on its own frames, and return what is to be sent.

        `elapsed_ticks` exceeds 1 after missed periods. Of the torques only the last one is sent. If more than
        `LONGEST_CATCH_UP_S` was missed, nothing is caught up: all frames belong to the present period, and
        the silence before it lets the watchdogs stop the motor.
        """
        if elapsed_ticks < 1:
            raise ValueError(f"elapsed_ticks = {elapsed_ticks}; a tick is later than the one before it")
        self.elapsed_ticks = elapsed_ticks
        if elapsed_ticks == 1:
            return self._run_period(frames_in, 0)
        most_ticks = round(LONGEST_CATCH_UP_S / self.config.tick_s)
        if elapsed_ticks <= most_ticks:
            last_sample = self.part(Received, "received").accelerometer_arrival
            due = due_counter(last_sample, self.ticks + elapsed_ticks)
            periods = divide_frames(frames_in, elapsed_ticks, due)
        else:
            periods = [*([] for _ in range(most_ticks - 1)), list(frames_in)]
        sent: list[Frame] = []
        for behind_ticks in range(len(periods) - 1, 0, -1):
            others = self._run_period(periods[-1 - behind_ticks], behind_ticks)
            sent += (one for one in others if one.can_id != SET_INPUT_TORQUE.can_id)
        newest = self._run_period(periods[-1], 0)
        first = 1 if newest and newest[0].can_id == SET_INPUT_TORQUE.can_id else 0
        return newest[:first] + sent + newest[first:]

    def _run_period(self, frames: Sequence[Frame], behind_ticks: int) -> list[Frame]:
        self.calibrate()
        return self.run_period(fit_frames(frames), behind_ticks)

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
        import filterpy.kalman  # noqa: F401, PLC0415 - now, not in the first tick: it takes a second

    def part(self, kind: type[Record], name: str) -> Record:
        """The member `name` of the `NodeState`, a record of type `kind`."""
        record: Record = getattr(self._state, name)
        return record

    @property
    def ticks(self) -> int:
        """The number of periods since power-up."""
        return self._state.ticks

    def run_period(self, frames: Sequence[Frame], behind_ticks: int) -> list[Frame]:
        """Run one control period, `behind_ticks` before the present one."""
        words = [WordFrame(can_id, len(data), word_of(data)) for can_id, data in frames]
        self._state, tx = tick(self.config, self._state, Rx(behind_ticks, len(words), words))
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
        values = parse_file(parameter_file, build)
    except ParameterError as error:
        node = make(config_of(parameters_of(with_overrides(build or {})), True))
        node.damage = str(error)
        return node
    return make(config_of(parameters_of(values), False))
