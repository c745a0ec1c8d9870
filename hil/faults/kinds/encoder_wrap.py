"""A position that is a count of turns."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, PrivateAttr

from firmware_py.interface.generated.records import EncoderEstimates
from hil.faults.fault import Fault
from hil.faults.on_plant import PhysicalFault
from plant_sim.plant import Plant
from plant_sim.scene import Scene


class EncoderWrap(PhysicalFault):
    """The drive's position is a count of revolutions, as a float32, not circular, and wraps at a limit."""

    kind: Literal["encoder-wrap"]
    count_rev: int = Field(ge=0, lt=2**24, description="the count at the fault's beginning, in revolutions")
    wraps_at_rev: int = Field(
        default=2**24, ge=1, le=2**24, description="the count that wraps to its negative, in revolutions"
    )

    _turns_rev: int = PrivateAttr()
    _last_rev: float | None = PrivateAttr()

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """A count that would have wrapped before."""
        if self.count_rev < self.wraps_at_rev:
            return None
        return (
            f"count_rev = {self.count_rev} is not below wraps_at_rev = {self.wraps_at_rev}; "
            "begin with a lower count, or let it wrap at a higher one"
        )

    def strike(self, plant: Plant, powered_up_s: float) -> None:
        """Begin to count."""
        self._turns_rev, self._last_rev = self.count_rev, None

    def reported(self, estimates: EncoderEstimates) -> EncoderEstimates:
        """The count, at a position that has moved by less than half a turn since the last report."""
        self.count()
        circular_rev, limit_rev = estimates.position_rev, self.wraps_at_rev
        if self._last_rev is not None:
            self._turns_rev -= round(circular_rev - self._last_rev)
        self._last_rev = circular_rev
        counted_rev = (self._turns_rev + circular_rev + limit_rev) % (2 * limit_rev) - limit_rev
        return estimates._replace(position_rev=counted_rev)
