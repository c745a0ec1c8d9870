"""Faults in processes, their clocks, and the firmware's parameter memory."""

import signal
from collections.abc import Sequence
from typing import Annotated, ClassVar, NamedTuple, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field

from hil.faults.fault import Fault
from hil.roster import FIRMWARE, as_choice, processes
from plant_sim.scene import Scene


def is_process(name: str) -> str:
    """Raise ValueError if no node with a process of its own has this name."""
    if name not in processes():
        raise ValueError(f"process = {name!r} is no process of the bench; give {as_choice(processes())}")
    return name


Process: TypeAlias = Annotated[str, AfterValidator(is_process)]


class Signal(NamedTuple):
    """A signal sent to a process."""

    at_s: float
    process: str
    number: signal.Signals


class HostFault(Fault):
    """A fault in processes, clocks or memory."""

    place: ClassVar[str] = "In processes, clocks and memory"


class ProcessFault(HostFault):
    """A fault that keeps a process from running while it acts."""

    is_beyond_log: ClassVar[bool] = True
    ends_process: ClassVar[bool] = False
    """Whether the process ends at the beginning."""
    starts_anew: ClassVar[bool] = False
    """Whether a new process starts at the end."""

    process: Process = Field(description="the process: plant or firmware")

    @property
    def acts_in(self) -> str | None:
        """Its process."""
        return self.process

    @property
    def silences(self) -> bool:
        """Always."""
        return True

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """The process is dead all the time."""
        for other in faults:
            if other is self or not isinstance(other, ProcessFault) or other.process != self.process:
                continue
            returns = other.starts_anew and self.acts(other.end_s)
            if other.ends_process and other.acts(self.at_s) and not returns:
                return (
                    f"the {self.process} does not run after the fault {other.kind!r} at {other.at_s:g} s; "
                    "let it act before, or leave it out"
                )
        return None

    def signals(self) -> list[Signal]:
        """The signals that have this effect on a real process."""
        return [Signal(self.at_s, self.process, signal.SIGKILL)]


class ClockFault(HostFault):
    """A fault of the clock of a process."""

    is_beyond_log: ClassVar[bool] = True

    def faulty_process(self) -> str:
        """The process whose clock it is."""
        raise NotImplementedError

    @property
    def acts_in(self) -> str | None:
        """The process whose clock it is."""
        return self.faulty_process()

    @property
    def silences(self) -> bool:
        """A process runs late by a wrong clock, or not for a while."""
        return True

    @property
    def ahead_s(self) -> float:
        """The time by which the clock is ahead while the fault acts."""
        return 0.0

    @property
    def latest_s(self) -> float:
        """The largest delay of a wake-up while the fault acts."""
        return 0.0


class MemoryFault(HostFault):
    """A fault of the firmware's parameter file."""

    @property
    def acts_in(self) -> str | None:
        """The firmware."""
        return FIRMWARE

    def damaged(self, text: str, noise: np.random.Generator) -> str:
        """What a firmware reads that starts while the fault acts."""
        raise NotImplementedError
