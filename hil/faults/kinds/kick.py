"""A kick to the striker."""

from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.on_plant import PhysicalFault


class Kick(PhysicalFault):
    """An impulse from outside changes the striker's velocity, once."""

    is_steady: ClassVar[bool] = True
    kind: Literal["kick"]
    change_m_s: float = Field(description="the change of velocity in m/s, positive towards the stop")

    @property
    def kick_m_s(self) -> float:
        """The change of velocity."""
        return self.change_m_s
