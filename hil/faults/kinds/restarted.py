"""A process that is restarted."""

from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.on_process import ProcessFault
from plant_sim.tables.quantities import Duration


class Restarted(ProcessFault):
    """A process is killed, and a new one starts from its initial state."""

    ends_process: ClassVar[bool] = True
    starts_anew: ClassVar[bool] = True
    kind: Literal["restarted"]
    duration_s: Duration = Field(ge=0.1, description="the time until the new process starts, in s")
