"""A position that is a count of turns."""

from typing import Literal

from pydantic import Field

from hil.faults.on_plant import PhysicalFault, TurnCounter


class EncoderWrap(PhysicalFault):
    """The drive's position is a count of revolutions, as a float32, not circular, and wraps at a limit."""

    kind: Literal["encoder-wrap"]
    count_rev: int = Field(ge=0, lt=2**24, description="the count at the fault's beginning, in revolutions")
    wraps_at_rev: int = Field(
        default=2**24, ge=1, le=2**24, description="the count that wraps to its negative, in revolutions"
    )

    def turn_counter(self) -> TurnCounter:
        """The counter of revolutions."""
        return TurnCounter(self.count_rev, self.wraps_at_rev)
