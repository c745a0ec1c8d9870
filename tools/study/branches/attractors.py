"""Impact orbits that simulations settle on: where branches start."""

import math
from collections.abc import Iterator
from itertools import product

from plant_sim.scene import Scene
from tools.study.branches.continuation import Vector
from tools.study.branches.impact_map import ImpactMap
from tools.study.branches.parameters import PARAMETERS, TURN_RAD, value_in, with_values
from tools.study.orbits import CLASSIFY, State, follow, motion, turn_s

SEED_RATIOS = (0.75, 0.85, 0.95, 1.0, 1.05, 1.15, 1.25, 1.35, 1.5)
SEED_SHARES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
"""Values, as shares of the scene's own for other parameters, at which attractors are looked for."""
SEED_PHASES, SEED_SPEEDS = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi), (0.1, 0.3, 0.6)
"""Crank angles, and rebound speeds over the scale of speed, from which the striker leaves the stop."""
SETTLING_TURNS = 150


def seeds(module: ImpactMap, over: str) -> Iterator[Vector]:
    """Attractors that simulations settle on, from several starts at several values of the parameter."""
    nominal = value_in(module.scene, over)
    values = SEED_RATIOS if over == "ratio" else [share * nominal for share in SEED_SHARES]
    for value in sorted({*values, nominal}, key=lambda one: abs(one - nominal)):
        if PARAMETERS[over].low < value < PARAMETERS[over].high:
            for phase, speed in product(SEED_PHASES, SEED_SPEEDS):
                scene = with_values(module.scene, {over: value})
                seed = settle(module, scene, {over: value}, phase, speed * module.speed_m_s)
                if seed is not None:
                    yield seed


def settle(
    module: ImpactMap, scene: Scene, values: dict[str, float], phase: float, speed_m_s: float
) -> Vector | None:
    """The orbit that one start from the stop settles on within SETTLING_TURNS, from its next impacts.

    None if it does not have the module's number of impacts and turns.
    """
    turns, m = module.turns, module.impacts
    protocol = CLASSIFY._replace(settle_s=SETTLING_TURNS * turn_s(scene))
    outcome = follow(scene, State(value_in(scene, "gap"), -speed_m_s, phase), protocol)
    if outcome.cycle != turns or round(outcome.impacts * turns) != m:
        return None
    impacts = motion(scene, outcome.end, turns * turn_s(scene)).impacts
    if len(impacts.t_s) != m:
        return None
    crank = impacts.crank_rad[0] + (impacts.t_s - impacts.t_s[0]) / turn_s(scene) * TURN_RAD
    return module.point(crank, impacts.v_m_s, values)
