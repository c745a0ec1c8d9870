"""What all faults have in common. A kind of fault is one class in one file of `hil.faults.kinds`.

The class is the table `[[script.faults]]` of a scenario, and its methods are its effect. Its base class says
where it acts and is called there: `on_bus`, `on_sensor`, `on_plant` or `on_process`. The scenario's checks
state the required reaction, on the truth: motor torque, stop force, impacts.
"""

import math
from collections.abc import Sequence
from typing import ClassVar

from pydantic import Field

from plant_sim.scene import Scene
from plant_sim.tables.table import Table


class Fault(Table):
    """The keys of every fault. It acts at times t with at_s ≤ t < at_s + duration_s."""

    place: ClassVar[str] = ""
    """Where faults of this kind act, as a heading of the reference."""
    is_steady: ClassVar[bool] = False
    """Whether it acts at its beginning and its end alone, and not from tick to tick."""
    is_beyond_log: ClassVar[bool] = False
    """Whether it changes which frames the firmware receives, or when it ticks, after a log has seen them."""

    kind: str
    at_s: float = Field(ge=0.0, description="the fault's beginning, in s from the start")
    duration_s: float | None = Field(
        default=None, gt=0.0, description="the fault's duration, in s; by default to the end of the run"
    )

    @property
    def end_s(self) -> float:
        """The end of the fault."""
        return math.inf if self.duration_s is None else self.at_s + self.duration_s

    def acts(self, t_s: float) -> bool:
        """Whether the fault acts at `t_s`, with a tolerance for rounded times."""
        return self.at_s - 1e-9 <= t_s < self.end_s - 1e-9

    def without_object(self, scene: Scene, faults: Sequence["Fault"]) -> str | None:
        """The reason why it cannot act in this scene, among these faults, with the remedy; None if it can."""
        return None
