"""The parts of one scene, together: what a solver takes and is compiled for."""

from typing import NamedTuple, TypeAlias

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.friction import Coulomb, NoFriction, Stribeck, Viscous
from plant_sim.parts.stop import HuntCrossley, KelvinVoigt, NoStop, RigidStop
from plant_sim.parts.striker import Striker

Drive: TypeAlias = IdealDrive | MotorDrive
Friction: TypeAlias = NoFriction | Viscous | Coulomb | Stribeck
Stop: TypeAlias = NoStop | RigidStop | KelvinVoigt | HuntCrossley


class Parts(NamedTuple):
    """One of each; kernels are specialised by the types of the four."""

    striker: Striker
    drive: Drive
    friction: Friction
    stop: Stop
