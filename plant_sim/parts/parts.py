"""The parts of one scene, together: what a solver takes and is compiled for."""

from typing import NamedTuple

from plant_sim.parts.drive import Drive
from plant_sim.parts.friction import Friction
from plant_sim.parts.stop import Stop
from plant_sim.parts.striker import Striker


class Parts(NamedTuple):
    """One of each; kernels are specialised by the types of the four."""

    striker: Striker
    drive: Drive
    friction: Friction
    stop: Stop
