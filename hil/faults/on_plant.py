"""Faults in the drive and the module, which act in the plant's node (`hil.faults.plant`)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import EncoderEstimates
from hil.drive.axis import DriveConfig, DriveState
from hil.faults.fault import Fault
from plant_sim.parts.parts import Parts

if TYPE_CHECKING:
    from plant_sim.plant import Plant


class PhysicalFault(Fault):
    """A fault in the drive or the module. Its methods are called while it acts."""

    place: ClassVar[str] = "In the drive and the module"
    cuts_supply: ClassVar[bool] = False
    """Whether the drive's electronics have no supply."""

    @property
    def acts_in(self) -> str | None:
        """The plant's node."""
        return "plant"

    def strike(self, plant: "Plant", powered_up_s: float) -> None:
        """Act on the plant, which was powered up at `powered_up_s`, once at the fault's beginning."""

    def parts(self, parts: Parts) -> Parts:
        """The module's parts."""
        return parts

    def config(self, config: DriveConfig) -> DriveConfig:
        """The drive's configuration."""
        return config

    def changes(self, parts: Parts, config: DriveConfig) -> bool:
        """Whether it changes the plant in every tick in which it acts."""
        return self.parts(parts) != parts or self.config(config) != config

    def drive(self, drive: DriveState) -> DriveState:
        """The drive's state at the beginning of a tick."""
        return drive

    def received(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """The frames that the drive receives, one for each frame on the bus."""
        return frames

    def given_n_m(self, torque_n_m: float, pole_pairs: int, crank_rad: float) -> float:
        """The motor's torque for the torque that the drive requests."""
        return torque_n_m

    def reported(self, estimates: EncoderEstimates) -> EncoderEstimates:
        """The drive's report of its position, from its circular position."""
        return estimates
