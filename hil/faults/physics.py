"""Faults of the drive and the module: changed parts, drive configuration and torque."""

import math
from collections.abc import Sequence

from hil.drive.axis import DriveConfig
from hil.scenario.fault_tables import (
    FrictionChanged,
    MotorStall,
    PhaseLoss,
    PhysicalFault,
    StiffnessChanged,
    StopMoved,
    SupplySag,
)
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.friction import times
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop

JAM_N_M = 10.0
"""Dry friction of a jammed crank, more than ten times the motor's torque: stops the crank within a tick."""


def broken_parts(parts: Parts, faults: Sequence[PhysicalFault]) -> Parts:
    """The module's parts while `faults` act."""
    for fault in faults:
        match fault:
            case StiffnessChanged(factor=factor):
                striker = parts.striker
                parts = parts._replace(striker=striker._replace(spring_n_m=factor * striker.spring_n_m))
            case FrictionChanged(factor=factor):
                parts = parts._replace(friction=times(parts.friction, factor))
            case StopMoved(by_m=by_m):
                stop = parts.stop
                if not isinstance(stop, NoStop):
                    parts = parts._replace(stop=stop._replace(position_m=stop.position_m + by_m))
            case MotorStall():
                if isinstance(parts.drive, MotorDrive):
                    parts = parts._replace(drive=parts.drive._replace(dry_n_m=JAM_N_M))
            case SupplySag(supply_v=supply_v):
                if isinstance(parts.drive, MotorDrive):
                    parts = parts._replace(drive=parts.drive._replace(supply_v=supply_v))
    return parts


def broken_config(config: DriveConfig, faults: Sequence[PhysicalFault]) -> DriveConfig:
    """The drive's configuration while `faults` act."""
    for fault in faults:
        if isinstance(fault, SupplySag):
            config = config._replace(supply_v=fault.supply_v)
    return config


def torque_share(faults: Sequence[PhysicalFault], pole_pairs: int, crank_rad: float) -> float:
    """Share of the requested torque that the motor produces.

    With one wire disconnected, current flows along one axis u of the windings only. Of a current requested
    along q, perpendicular to the rotor's flux, only the projection (q·u) u flows, and its component along q
    produces torque: the share is (q·u)² = sin²(p θ).
    """
    if any(isinstance(fault, PhaseLoss) for fault in faults):
        return math.sin(pole_pairs * crank_rad) ** 2
    return 1.0
