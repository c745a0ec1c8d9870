"""The parts of one scene."""

from typing import NamedTuple

from plant_sim.parts.drive import Drive
from plant_sim.parts.friction import Friction
from plant_sim.parts.housing import Housing, Level
from plant_sim.parts.linkage import Linkage, Sine
from plant_sim.parts.stop import Stop
from plant_sim.parts.striker import Striker
from plant_sim.parts.wearer import NoWearer, Wearer
from plant_sim.parts.winding import IdealCurrent, Winding


class Parts(NamedTuple):
    """One part for each slot; the declared types are the parts that a slot can hold (`plant_sim.kinds`)."""

    striker: Striker
    drive: Drive
    friction: Friction
    stop: Stop
    linkage: Linkage = Sine()
    housing: Housing = Level()
    wearer: Wearer = NoWearer()
    winding: Winding = IdealCurrent()
