"""A scene run on its own, by the solver that fits it."""

import math
from dataclasses import replace

import numpy as np

from plant_sim.methods import choose
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.result import MotionState, Phase, SimulationResult
from plant_sim.scene import Scene
from plant_sim.solvers import adaptive, exact, stepping
from plant_sim.tilt import levelled, tilted


class SimulationError(ValueError):
    """A run that was asked for wrongly."""


def simulate(
    scene: Scene, until_s: float, torque_n_m: float = 0.0, samples_s: float | None = None
) -> SimulationResult:
    """Run a scene from its start to `until_s` under a held motor torque.

    `samples_s` asks for the motion at that spacing, both ends included.
    """
    if not (math.isfinite(until_s) and until_s > 0.0):
        raise SimulationError(f"until_s = {until_s}: wanted a positive, finite time to run to, in s")
    if not math.isfinite(torque_n_m):
        raise SimulationError(f"torque_n_m = {torque_n_m}: wanted a finite motor torque, in N m")
    if samples_s is not None and not (math.isfinite(samples_s) and samples_s > 0.0):
        raise SimulationError(f"samples_s = {samples_s}: wanted a positive, finite spacing, in s")
    parts = scene.parts()
    initial = initial_state(scene, parts)
    if torque_n_m != 0.0 and isinstance(parts.drive, IdealDrive):
        raise SimulationError(
            f"torque_n_m = {torque_n_m} is given for an ideal drive, which takes none; "
            "leave it out, or set drive.model = 'motor' or 'dq-motor'"
        )
    grid = None if samples_s is None else np.append(np.arange(0.0, until_s, samples_s), until_s)
    level = levelled(parts)
    choice = choose(scene, level)
    if choice.step_s is not None:
        result = tilted(stepping.simulate(level, initial, until_s, choice.step_s, grid), parts, initial)
    elif choice.method == "exact":
        result = tilted(exact.simulate(level, initial, until_s, grid), parts, initial)
    else:
        result = adaptive.simulate(
            parts, initial, until_s, grid, torque_n_m=torque_n_m, accuracy=scene.solver.accuracy
        )
    return result if choice.note is None else replace(result, notes=(*result.notes, choice.note))


def initial_state(scene: Scene, parts: Parts | None = None) -> MotionState:
    """The module at t = 0; its phase is for the solver to find. `parts` are the scene's, if at hand."""
    drive = (parts or scene.parts()).drive
    return MotionState(
        t_s=0.0,
        x_m=scene.initial_x_m,
        v_m_s=scene.initial.v_m_s,
        crank_rad=drive.phase_rad,
        omega_rad_s=drive.omega_rad_s if isinstance(drive, IdealDrive) else 0.0,
        phase=Phase.FLIGHT,
    )
