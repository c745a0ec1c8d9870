"""A crank that jams."""

from typing import ClassVar, Literal

from hil.faults.on_plant import PhysicalFault
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts

JAM_N_M = 10.0
"""Dry friction of a jammed crank, more than ten times the motor's torque: stops the crank within a tick."""


class MotorStall(PhysicalFault):
    """The crank jams."""

    is_steady: ClassVar[bool] = True
    kind: Literal["motor-stall"]

    def parts(self, parts: Parts) -> Parts:
        """A drive with dry friction that no torque overcomes."""
        if not isinstance(parts.drive, MotorDrive):
            return parts
        return parts._replace(drive=parts.drive._replace(dry_n_m=JAM_N_M))
