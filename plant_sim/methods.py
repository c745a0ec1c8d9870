"""Selection of a solver and its step for a scene: the cheapest method that meets the accuracy.

The costs are the ones that `vibrohil trade` prints, rounded up. They rank the methods; they do not predict
the time of a run on a particular machine.
"""

import math
from typing import NamedTuple

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import RigidStop
from plant_sim.scene import Scene


class Choice(NamedTuple):
    """A method with its step (stepping only) and the reason for it (`auto` only)."""

    method: str
    step_s: float | None = None
    note: str | None = None


class SteppingCost(NamedTuple):
    """Error and cost of time stepping at a step of `step_rad` of the faster of drive and free oscillation."""

    step_rad: float
    error: float
    """Largest state error per forcing period, as a share of the motion's length."""
    cost_us_s: float
    """Microseconds per simulated second at table1's frequencies."""


STEPPING_COSTS = (
    SteppingCost(0.1, 0.1, 5.0),
    SteppingCost(0.03, 0.03, 16.0),
    SteppingCost(0.01, 0.01, 50.0),
    SteppingCost(0.003, 0.003, 160.0),
    SteppingCost(0.001, 0.001, 500.0),
    SteppingCost(0.0003, 0.0004, 1600.0),
)
"""Coarsest first. The method is of first order: the error is proportional to the step."""

ADAPTIVE_COST_US_S = 12.0
"""Cost of the adaptive solver at the loosest accuracy, where a step is limited to some radians."""

FINEST_STEP_RAD = 1e-4
"""With a smaller step, time stepping takes longer than any other method takes to reach rounding error."""


def choose(scene: Scene, parts: Parts) -> Choice:
    """The method of `scene.solver`; `auto` selects the cheapest one that meets the accuracy.

    `parts` are those of the level scene (`plant_sim.tilt`), because the sag by a tilt counts.
    """
    solver = scene.solver
    if solver.method == "stepping":
        return Choice("stepping", solver.step_s or _step_for(scene, parts, solver.accuracy))
    if solver.method != "auto":
        return Choice(solver.method)
    if scene.beyond_stepping:
        alone = " and ".join(scene.beyond_stepping)
        return Choice("adaptive", note=f"auto took adaptive: no other method has {alone}")
    if not scene.beyond_closed_form:
        return Choice("exact", note="auto took exact: a closed form is both cheapest and most accurate")
    coarsest = STEPPING_COSTS[0]
    error_m = coarsest.error * _length_m(scene, parts)
    if error_m <= solver.accuracy and coarsest.cost_us_s < ADAPTIVE_COST_US_S:
        step_s = coarsest.step_rad / _fastest_rad_s(scene, parts)
        return Choice(
            "stepping",
            step_s,
            f"auto took stepping at {step_s:.3g} s: up to {error_m:.2g} m of error a period, within the "
            f"{solver.accuracy:g} asked for, at less than half of the adaptive solver's time",
        )
    return Choice(
        "adaptive", note=f"auto took adaptive: stepping at its cheapest errs by {error_m:.2g} m a period"
    )


def _step_for(scene: Scene, parts: Parts, accuracy: float) -> float:
    """The longest step, s, whose measured error is within `accuracy`; below, first order holds."""
    length_m, fastest_rad_s = _length_m(scene, parts), _fastest_rad_s(scene, parts)
    for cost in STEPPING_COSTS:
        if cost.error * length_m <= accuracy:
            return cost.step_rad / fastest_rad_s
    finest = STEPPING_COSTS[-1]
    share = accuracy / (finest.error * length_m)
    return max(finest.step_rad * share, FINEST_STEP_RAD) / fastest_rad_s


def _length_m(scene: Scene, parts: Parts) -> float:
    """An upper estimate of the striker's swing, m: the sum of drive, gap and start."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    gap_m = abs(stop.position_m - striker.rest_length_m) if isinstance(stop, RigidStop) else 0.0
    start_m = math.hypot(scene.initial_x_m - striker.rest_length_m, scene.initial.v_m_s / scene.natural_rad_s)
    return drive.amplitude_m + gap_m + start_m


def _fastest_rad_s(scene: Scene, parts: Parts) -> float:
    drive = parts.drive
    return max(scene.natural_rad_s, abs(drive.omega_rad_s) if isinstance(drive, IdealDrive) else 0.0)
