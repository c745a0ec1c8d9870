"""A foreign node that sends random frames."""

from typing import ClassVar, Literal

from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.faults.on_bus import LineFault, Step

IDENTIFIERS = 0x800


class Flood(LineFault):
    """A foreign node that sends random data of random length on random identifiers."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["flood"]
    frames_a_tick: int = Field(ge=1, le=1000, description="the number of frames in each tick of the bench")

    def foreign_frames(self, step: Step) -> list[Frame]:
        """The random frames of a step."""
        noise = self.memory.noise
        return [
            Frame(int(noise.integers(IDENTIFIERS)), noise.bytes(int(noise.integers(9))))
            for _ in range(self.frames_a_tick)
        ]
