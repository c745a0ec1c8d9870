"""A process that stalls."""

import signal
from typing import Literal

from pydantic import Field

from hil.faults.on_process import ProcessFault, Signal
from plant_sim.tables.quantities import Duration


class Paused(ProcessFault):
    """A process is stopped, and then continues."""

    kind: Literal["paused"]
    duration_s: Duration = Field(gt=0.0, description="the duration of the stall, in s")

    def signals(self) -> list[Signal]:
        """Stop and continue."""
        return [
            Signal(self.at_s, self.process, signal.SIGSTOP),
            Signal(self.end_s, self.process, signal.SIGCONT),
        ]
