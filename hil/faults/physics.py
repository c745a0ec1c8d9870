"""Faults of the drive and the module: what they make of parts, drive configuration and torque."""

import math
from collections.abc import Sequence
from typing import TypeGuard, get_args

from hil.drive.axis import DriveConfig
from hil.scenario.fault_tables import (
    Fault,
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
"""More than ten times the motor's torque, which brings the crank to rest within a tick."""


def is_physical(fault: Fault) -> TypeGuard[PhysicalFault]:
    """Whether a fault acts here."""
    return isinstance(fault, get_args(PhysicalFault))


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
    """The share of the torque asked for that the motor gives.

    With one wire off, current flows along one axis u of the windings alone. Of a current asked for along q,
    at right angles to the rotor's flux, only its projection (q·u) u flows, and of that only (q·u)² makes
    torque: sin²(p θ).
    """
    if any(isinstance(fault, PhaseLoss) for fault in faults):
        return math.sin(pole_pairs * crank_rad) ** 2
    return 1.0
