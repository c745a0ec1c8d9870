"""The meaning of an accuracy: the largest state error per forcing period, in m and in m/s over ω."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from changed_scenes import KELVIN_VOIGT, changed

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.result import MotionState
from plant_sim.scene import load_scene
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive import adaptive

LONGEST_TURN_S = 10.0


def turns(parts: Parts, start: MotionState, torque_n_m: float, number: int) -> Iterator[tuple[Any, Any]]:
    """The true states at the begin and end of each turn of the crank from `start` on."""
    drive = parts.drive
    for _ in range(number):
        start = replace(start, t_s=0.0)
        if isinstance(drive, IdealDrive):
            turn_s = 2.0 * math.pi / drive.omega_rad_s
        else:
            grid = np.linspace(0.0, LONGEST_TURN_S, 10001)
            run = adaptive.simulate(parts, start, LONGEST_TURN_S, grid, torque_n_m=torque_n_m, accuracy=1e-8)
            assert run.samples is not None
            crank = np.unwrap(run.samples.crank_rad)
            turn_s = float(grid[np.argmax(crank - crank[0] >= 2.0 * math.pi)])
        end = adaptive.simulate(parts, start, turn_s, torque_n_m=torque_n_m, accuracy=1e-13).final
        yield start, end
        start = end


@pytest.mark.parametrize(
    ("base", "changes", "torque_n_m"),
    [
        ("table1-viscous", {}, 0.0),
        ("table1-coulomb", {}, 0.0),
        ("table1-stribeck", {}, 0.0),
        ("gait", {}, 0.0),
        ("table1-motor-soft", {"stop": KELVIN_VOIGT}, 0.02),
        # As the crank starts, the last terms of a series over four radians are smaller than those cut off.
        ("gait-motor-soft", {"stop": KELVIN_VOIGT}, 0.05),
    ],
)
def test_the_error_in_a_turn_is_within_the_accuracy(
    base: str, changes: dict[str, Any], torque_n_m: float
) -> None:
    """Each turn from the true state; the crank's angle counts as the piston's path."""
    scene = load_scene(changed(base, {"sensors": None, **changes}))
    parts, natural_rad_s = scene.parts(), scene.natural_rad_s
    for begin, true in turns(parts, initial_state(scene), torque_n_m, 6):
        for accuracy in (1e-4, 1e-5, 1e-6):
            found = adaptive.simulate(parts, begin, true.t_s, torque_n_m=torque_n_m, accuracy=accuracy).final
            assert found.x_m == pytest.approx(true.x_m, rel=0.0, abs=accuracy)
            assert found.v_m_s == pytest.approx(true.v_m_s, rel=0.0, abs=accuracy * natural_rad_s)
            ahead_rad = math.remainder(found.crank_rad - true.crank_rad, 2.0 * math.pi)
            assert abs(ahead_rad) * parts.drive.amplitude_m <= accuracy
