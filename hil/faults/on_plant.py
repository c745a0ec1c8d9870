"""Faults in the drive and the module, which act in the plant's node (`hil.faults.plant`)."""

from collections.abc import Sequence
from typing import ClassVar

from firmware_py.interface.frame import Frame
from hil.drive.axis import DriveConfig, DriveState
from hil.faults.fault import Fault
from plant_sim.parts.parts import Parts


class TurnCounter:
    """A position that counts revolutions from `count_rev` on, and wraps to its negative at `wraps_at_rev`."""

    def __init__(self, count_rev: int, wraps_at_rev: int) -> None:
        self._turns_rev = count_rev
        self._wraps_at_rev = wraps_at_rev
        self._last_rev: float | None = None

    def counted_rev(self, circular_rev: float) -> float:
        """The count at a position of 0 … 1, which has moved by less than half a turn since the last call."""
        if self._last_rev is not None:
            self._turns_rev -= round(circular_rev - self._last_rev)
        self._last_rev = circular_rev
        wide_rev = 2 * self._wraps_at_rev
        return (self._turns_rev + circular_rev + self._wraps_at_rev) % wide_rev - self._wraps_at_rev


class PhysicalFault(Fault):
    """A fault in the drive or the module. Its methods are called while it acts."""

    place: ClassVar[str] = "In the drive and the module"
    cuts_supply: ClassVar[bool] = False
    """Whether the drive's electronics have no supply."""

    @property
    def kick_m_s(self) -> float:
        """The change of the striker's velocity at the beginning."""
        return 0.0

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

    def turn_counter(self) -> TurnCounter | None:
        """The counter by which the drive reports its position, made at the beginning."""
        return None
