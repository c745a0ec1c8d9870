"""A clock with jitter."""

from typing import Literal

from pydantic import Field

from hil.faults.on_process import ClockFault, Process
from plant_sim.tables.quantities import Duration


class ClockJitter(ClockFault):
    """A clock that wakes its process late, by a random time."""

    kind: Literal["clock-jitter"]
    process: Process = Field(description="the process: plant or firmware")
    largest_s: Duration = Field(
        gt=0.0, le=0.1, description="the largest delay, in s; each is sampled from 0 to this"
    )

    def faulty_process(self) -> str:
        """The given process."""
        return self.process

    @property
    def latest_s(self) -> float:
        """The largest delay."""
        return self.largest_s
