"""Simulation of a scene by the solver that fits it."""

import math
from dataclasses import replace

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.result import MotionState, Phase, SimulationResult
from plant_sim.scene import Scene, require_scene
from plant_sim.solvers.adaptive import adaptive
from plant_sim.solvers.adaptive.adaptive import Torque
from plant_sim.solvers.exact import exact
from plant_sim.validation_messages import real
from text_input import RefusalError


class SimulationError(RefusalError, ValueError):
    """Invalid arguments of a simulation."""


def simulate(
    scene: Scene, until_s: float, torque_n_m: Torque = 0.0, samples_s: float | None = None
) -> SimulationResult:
    """Simulate a scene from its start to `until_s` under a motor torque, N m.

    The torque is constant, or a function of time that is read every `TORQUE_PERIOD_S` and held in between, as
    a drive holds its command. `samples_s` requests samples of the motion at that spacing, both ends included.
    All arguments may be any type of real number. Raises `SimulationError`, or the solver's `SolverError` or
    `UnsupportedSceneError`.
    """
    until_s = _real(until_s, "until_s", "time to run to, in s", above_zero=True)
    torque = _torque(torque_n_m)
    grid = None if samples_s is None else _grid(until_s, samples_s)
    parts = require_scene(scene).parts()
    initial = initial_state(scene, parts)
    if (callable(torque) or torque != 0.0) and isinstance(parts.drive, IdealDrive):
        raise SimulationError(
            f"torque_n_m = {torque_n_m} is given for an ideal drive, which takes none; "
            "leave it out, or set drive.model = 'motor' or 'dq-motor'"
        )
    method, notes = _method(scene)
    if method == "exact":
        result = exact.simulate(parts, initial, until_s, grid)
    else:
        result = adaptive.simulate(
            parts, initial, until_s, grid, torque_n_m=torque, accuracy=scene.solver.accuracy
        )
    return replace(result, notes=notes)


def _method(scene: Scene) -> tuple[str, tuple[str, ...]]:
    """The method of `scene.solver`; `auto` takes the closed form if there is one, and notes its choice."""
    if scene.solver.method != "auto":
        return scene.solver.method, ()
    if not scene.beyond_closed_form:
        return "exact", ("auto took exact: a closed form is both cheapest and most accurate",)
    beyond = " and ".join(scene.beyond_closed_form)
    return "adaptive", (f"auto took adaptive: there is no closed form for {beyond}",)


MOST_SAMPLES = 10_000_000
"""Most samples of one run: 400 MB."""


def _grid(until_s: float, samples_s: float) -> FloatArray:
    """Times from 0 to `until_s`, each once; a time that rounds to the end is left out."""
    spacing_s = _real(samples_s, "samples_s", "spacing of samples, in s", above_zero=True)
    count = until_s / spacing_s
    if count > MOST_SAMPLES:
        raise SimulationError(
            f"samples_s = {spacing_s} requests {count:.3g} samples up to {until_s} s; wanted {MOST_SAMPLES} "
            "at most, give a longer spacing"
        )
    return np.append(spacing_s * np.arange(math.ceil(count * (1.0 - 1e-12))), until_s)


def _torque(torque_n_m: Torque) -> Torque:
    """The torque, whose every value is checked."""
    if not callable(torque_n_m):
        return _real(torque_n_m, "torque_n_m", "motor torque, in N m")

    def checked_n_m(t_s: float) -> float:
        return _real(torque_n_m(t_s), f"torque_n_m({t_s})", "motor torque, in N m")

    return checked_n_m


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
