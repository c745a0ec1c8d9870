"""Simulation of a scene by the solver that fits it."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plant_sim.methods import choose
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.result import MotionState, Phase, SimulationResult
from plant_sim.scene import Scene, require_scene
from plant_sim.solvers import stepping
from plant_sim.solvers.adaptive import adaptive
from plant_sim.solvers.exact import exact
from plant_sim.tilt import levelled, tilted
from plant_sim.validation_messages import real


class SimulationError(ValueError):
    """Invalid arguments of a simulation."""


def simulate(
    scene: Scene, until_s: float, torque_n_m: float = 0.0, samples_s: float | None = None
) -> SimulationResult:
    """Simulate a scene from its start to `until_s` under a constant motor torque, N m.

    `samples_s` requests samples of the motion at that spacing, both ends included. All arguments may be any
    type of real number. Raises
    `SimulationError`, or the solver's `SolverError` or `UnsupportedSceneError`.
    """
    until_s = _real(until_s, "until_s", "time to run to, in s", above_zero=True)
    torque_n_m = _real(torque_n_m, "torque_n_m", "motor torque, in N m")
    grid = None if samples_s is None else _grid(until_s, samples_s)
    parts = require_scene(scene).parts()
    initial = initial_state(scene, parts)
    if torque_n_m != 0.0 and isinstance(parts.drive, IdealDrive):
        raise SimulationError(
            f"torque_n_m = {torque_n_m} is given for an ideal drive, which takes none; "
            "leave it out, or set drive.model = 'motor' or 'dq-motor'"
        )
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


MOST_SAMPLES = 10_000_000
"""Most samples of one run: 400 MB."""


def _grid(until_s: float, samples_s: float) -> NDArray[np.float64]:
    """Times from 0 to `until_s`, each once; a time that rounds to the end is left out."""
    spacing_s = _real(samples_s, "samples_s", "spacing of samples, in s", above_zero=True)
    count = until_s / spacing_s
    if count > MOST_SAMPLES:
        raise SimulationError(
            f"samples_s = {spacing_s} asks for {count:.3g} samples up to {until_s} s; wanted {MOST_SAMPLES} "
            "at most, give a longer spacing"
        )
    return np.append(spacing_s * np.arange(math.ceil(count * (1.0 - 1e-12))), until_s)


def _real(value: object, name: str, meaning: str, above_zero: bool = False) -> float:
    number = real(value)
    if not math.isfinite(number) or (above_zero and number <= 0.0):
        kind = "a positive, finite" if above_zero else "a finite"
        raise SimulationError(f"{name} = {value!r}: wanted {kind} {meaning}")
    return number


def initial_state(scene: Scene, parts: Parts | None = None) -> MotionState:
    """State of the module at t = 0; the solver determines its phase. `parts`: the scene's, if known."""
    drive = (parts or scene.parts()).drive
    return MotionState(
        t_s=0.0,
        x_m=scene.initial_x_m,
        v_m_s=scene.initial.v_m_s,
        crank_rad=drive.phase_rad,
        omega_rad_s=drive.omega_rad_s if isinstance(drive, IdealDrive) else 0.0,
        phase=Phase.FLIGHT,
    )
