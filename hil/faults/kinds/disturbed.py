"""Transmissions destroyed on the wire."""

from typing import Literal

from hil.faults.on_bus import ModelledFault, NamedFrames


class Disturbed(NamedFrames, ModelledFault):
    """Transmissions destroyed on the wire: error frames, repetition, error counters."""

    kind: Literal["disturbed"]

    @property
    def destroyed_ids(self) -> frozenset[int]:
        """The identifiers of the frames."""
        return self.can_ids

    def acted(self, destroyed: int) -> int:
        """The transmissions destroyed."""
        return destroyed
