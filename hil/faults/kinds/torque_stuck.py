"""A drive that ignores its command."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import SetInputTorque
from hil.faults.on_plant import PhysicalFault
from plant_sim.tables.quantities import Torque


class TorqueStuck(PhysicalFault):
    """The drive ignores its torque command and gives a constant torque while its axis is closed."""

    kind: Literal["torque-stuck"]
    torque_n_m: Torque = Field(ge=-10.0, le=10.0, description="the drive's torque, in N m")

    def received(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """The constant torque in the place of each command."""
        stuck = codec.SET_INPUT_TORQUE.encode(SetInputTorque(self.torque_n_m))
        return [stuck if frame.can_id == stuck.can_id else frame for frame in frames]
