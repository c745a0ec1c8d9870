"""A crank that makes a whole number of turns a stride, locked to the phase of the walk."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.walking import Walking
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import Scene, load_scene
from tools.campaign.trial.sampling import DEFAULT_SEED
from tools.study.cases import Case, case
from tools.study.feasibility.feasibility import STEP_S, Driven
from tools.study.orbits import State
from tools.study.pulse import judging
from tools.study.pulse.gate import WINDOW_MIDDLE
from tools.study.pulse.orbits import found_orbit

RUN_IN = 60
"""Strides before the first judged stride."""
SHIFT = 0.2
"""Share of an impact's lateness by which the crank's phase is shifted after the impact."""
LARGEST_SHIFT_RAD = 0.3
IDLE_S = 30.0


class Ground(NamedTuple):
    """Conditions of a walk: the stop's contact time, whether there is a wearer, and the leg's motion."""

    name: str
    contact_s: float
    worn: bool
    range_share: float
    variability: float


WALK = Ground("walk", 0.03, True, 1.0, 0.02)
"""The walk that is judged, with stop and wearer of the scene `walking`."""
GROUNDS = (
    Ground("hard, still, even", 0.005, False, 0.0, 0.0),
    Ground("soft stop, wearer", 0.03, True, 0.0, 0.0),
    Ground("2 % variability", 0.005, False, 0.0, 0.02),
    Ground("moving leg", 0.005, False, 1.0, 0.0),
)
"""The conditions in which the orbit was found, and variants that each change one condition of the walk."""
LADDER_HZ = 0.8
WEARER = {"plate_kg": 1.0, "ankle_n_m": 2000.0, "ankle_n_s_m": 40.0}


def scene(module: Case, axis: str, stride_hz: float, start: State, ground: Ground = WALK) -> Scene:
    """Return the scene of a module on a leg, with an ideal crank, from the state `start`."""
    tables: dict[str, Any] = {
        "striker": module.striker_table(),
        "drive": {
            "model": "ideal",
            "amplitude_m": module.amplitude_m,
            "speed_rad_s": 0.0,
            "phase_rad": start.crank_rad,
        },
        "friction": module.friction_table(),
        "stop": {
            "law": "hunt-crossley",
            "position_m": module.stop_m,
            "restitution": module.restitution,
            "contact_s": ground.contact_s,
        },
        "initial": {"x_m": module.rest_length_m + start.y_m, "v_m_s": start.v_m_s},
        "gait": {
            "axis": axis,
            "range_share": ground.range_share,
            "variability": ground.variability,
            "pace": [{"at_s": 0.0, "stride_hz": stride_hz}],
        },
        "solver": {"accuracy": 1e-6},
    }
    if ground.worn:
        tables["wearer"] = WEARER
    return load_scene(tables)


def locked(which: Scene, turns: int, seed: int, duration_s: float) -> judging.Walked:
    """Simulate a walk with `turns` of the crank a stride.

    The crank's phase is shifted slowly until the impact is in the middle of the push-off window.
    """
    plant = Plant(which, seed)
    drive, walking = plant.parts.drive, plant.parts.housing
    assert isinstance(drive, IdealDrive)
    assert isinstance(walking, Walking)
    whole = 2.0 * math.pi * turns
    angle_rad = drive.phase_rad
    offset_rad = angle_rad - whole * judging.cycles(walking, 0.0)
    steps = round(duration_s / STEP_S)
    t_s, crank_rad, felt_n = (np.empty(steps) for _ in range(3))
    impacts: list[Impact] = []
    for k in range(steps):
        if k % 5 == 0 and turns > 0:
            goal_rad = whole * judging.cycles(walking, (k + 5) * STEP_S) + offset_rad
            omega_rad_s = (goal_rad - angle_rad) / (5.0 * STEP_S)
            plant.replace_parts(plant.parts._replace(drive=drive._replace(omega_rad_s=omega_rad_s)))
            angle_rad = goal_rad
        plant.advance(0.0, STEP_S)
        now = plant.now
        t_s[k], crank_rad[k] = (k + 1) * STEP_S, angle_rad
        felt_n[k] = now.stop_force_n if which.wearer is None else now.felt_force_n
        new = plant.take_impacts()
        impacts += new
        for impact in judging.hits(new):
            late = (judging.cycles(walking, impact.t_s) - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5
            shift_rad = SHIFT * whole * late
            offset_rad += min(max(shift_rad, -LARGEST_SHIFT_RAD), LARGEST_SHIFT_RAD)
    return judging.Walked(Driven(impacts, t_s, crank_rad, felt_n), walking)


class Made(NamedTuple):
    """A kind of module; with its spring, `turns` of the crank a stride give the speed ratio `ratio`."""

    name: str
    way: str
    axis: str
    turns: int
    ratio: float
    gap_over_amplitude: float
    gap_m: float | None
    """None: the gap for which the steady v⁻ is V_M_S."""
    made_hz: float | None = None
    """Cadence for which the module is designed; None: for each cadence a module of its own."""


V_M_S = 0.8
"""v⁻ for which stop and wearer of the scene `walking` give a felt pulse of 16 N."""

MADE = (
    Made("60 mm", judging.TURN, "outward", 1, 1.1, 3.0, 0.06),
    Made("60 mm, for 0.8 Hz", judging.TURN, "outward", 1, 1.1, 3.0, 0.06, 0.8),
    Made("120 mm", judging.TURN, "outward", 1, 1.1, 3.0, 0.12),
    Made("60 mm", judging.TURN, "forward", 1, 1.1, 3.0, 0.06),
    Made("60 mm", judging.TURN, "up", 1, 1.1, 3.0, 0.06),
    Made("r 0.82", judging.SUBHARMONIC, "outward", 2, 0.82, 2.5, None),
    Made("r 0.87", judging.SUBHARMONIC, "outward", 2, 0.87, 2.5, None),
    Made("r 2.2", judging.SUBHARMONIC, "outward", 2, 2.2, 0.75, None),
    Made("r 0.89", judging.SUBHARMONIC, "outward", 3, 0.89, 3.75, None),
    Made("r 0.91", judging.SUBHARMONIC, "outward", 4, 0.91, 5.0, None),
    Made("r 0.92", judging.SUBHARMONIC, "outward", 5, 0.92, 6.0, None),
)


def made_for(kind: Made, stride_hz: float) -> tuple[Case, State] | None:
    """Return the module for a cadence, and a state on its orbit; None if there is no orbit.

    With one turn a stride the state is at rest.
    """
    natural_rad_s = 2.0 * math.pi * (kind.made_hz or stride_hz) * kind.turns / kind.ratio
    unit = case(
        "table1", "viscous", spring_n_m=0.8 * natural_rad_s**2, amplitude_m=0.06 / kind.gap_over_amplitude
    )
    start, gap_m = State(0.0, 0.0, 0.0), unit.gap_m
    if kind.way == judging.SUBHARMONIC:
        orbit = found_orbit(unit, kind.ratio, kind.turns)
        if orbit is None:
            return None
        start = State(orbit.end_y_m, orbit.end_v_m_s, orbit.end_crank_rad)
        gap_m *= V_M_S / orbit.v_mean_m_s
    if kind.gap_m is not None:
        gap_m = kind.gap_m
    scale = gap_m / unit.gap_m  # orbits scale with these lengths, the only ones of the motion
    module = replace(unit, amplitude_m=unit.amplitude_m * scale, stop_m=unit.rest_length_m + gap_m)
    return module, State(start.y_m * scale, start.v_m_s * scale, start.crank_rad)


def made_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """Compute the row of one kind of module at one cadence in one set of conditions."""
    kind, hz, ground = Made(**spec["kind"]), spec["stride_hz"], Ground(**spec["ground"])
    row: dict[str, Any] = {
        "way": kind.way,
        "module": kind.name,
        "ground": ground.name,
        "axis": kind.axis,
        "stride_hz": hz,
        "turns": kind.turns,
        "strides": 0,
    }
    made = made_for(kind, hz)
    if made is not None:
        module, start = made
        seconds = (RUN_IN + judging.JUDGED + 2) / hz
        which = scene(module, kind.axis, hz, start, ground)
        walks = [
            locked(which, kind.turns, DEFAULT_SEED + k, seconds) for k in range(judging.WALKERS[kind.way])
        ]
        parked = State(-module.amplitude_m, 0.0, -0.5 * math.pi)
        resting = scene(module, kind.axis, hz, parked, ground)
        alone = judging.hits(locked(resting, 0, DEFAULT_SEED, IDLE_S).run.impacts)
        row |= {
            "spring_n_m": module.spring_n_m,
            "amplitude_m": module.amplitude_m,
            "gap_m": module.gap_m,
            "leg_alone_hz": len(alone) / IDLE_S,
            **judging.judged(walks, RUN_IN),
        }
    return pa.Table.from_pylist([row], schema=judging.COLUMNS), {}
