"""What each part of a scene costs, and what it changes: one impact orbit, one part changed at a time.

The orbit is table1's at r = 1.3. Its fold is where the blows end as the crank is made faster step by step.
A motor is held at speed by a PI loop; timed, it runs on under the loop's last mean torque.
"""

import copy
import math
import statistics
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene, load_scene, read_scene
from plant_sim.sensing import NoSensing, Probe, allocate_sensing
from plant_sim.simulate import initial_state
from plant_sim.solvers.adaptive import IMPACTS_AT_ONCE, NO_GRID, NO_SAMPLES, peak_felt_force_n, run
from plant_sim.solvers.memory import ELAPSED, IMPULSE, PEAK_FORCE, Memory, allocate
from plant_sim.solvers.motion import work_place
from tools.trade.prices import COST_UNIT, Progress

RATIO = 1.3
SETTLE_PERIODS, LOOK_PERIODS = 60, 60
FOLD_PERIODS = 40
"""At each speed on the way to the fold; of which the last quarter must strike."""
FOLD_STEP = 0.01
FASTEST = 2.0

LOOP_S = 5e-3
"""Of the speed loop; below, its gains, which hold r = 1.3 with 3 % of ripple, and its first torque."""
LOOP_N_M_S, LOOP_N_M, LOOP_START_N_M = 0.05, 0.3, 0.06

HERTZ = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}

# Just rebounded, the crank 27° past its forward dead centre: on the orbit with one impact a period.
ORBIT: dict[str, Any] = {
    "drive": {"model": "ideal", "amplitude_m": 0.02, "ratio": RATIO, "phase_rad": 2.04},
    "stop": HERTZ,
    "initial": {"x_m": 0.1799, "v_m_s": -0.455},
}

PARTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("viscous, ideal, Hunt–Crossley", {}),
    ("no friction", {"friction": {"law": "none"}}),
    # Dry friction of about the viscous one's force: μ m g = 0.16 N against b v⁻ = 0.18 N.
    ("Coulomb, μ = 0.02", {"friction": {"law": "coulomb", "mu": 0.02}}),
    (
        "Stribeck, μ = 0.02, μ_s 0.03",
        {"friction": {"law": "stribeck", "mu": 0.02, "mu_s": 0.03, "v_s_m_s": 0.05, "delta": 1.0}},
    ),
    ("rigid stop", {"stop": {"law": "rigid", "position_m": 0.18, "restitution": 0.5}}),
    ("Kelvin–Voigt, 10 ms", {"stop": {**HERTZ, "law": "kelvin-voigt"}}),
    ("motor at speed", {"drive": {"model": "motor", "amplitude_m": 0.02, "phase_rad": 2.04}}),
    ("sensors", {"sensors": {}}),
    ("rod of 60 mm", {"drive": {**ORBIT["drive"], "rod_m": 0.06}}),
    ("tilt of 0.1 rad uphill", {"housing": {"tilt_rad": 0.1}}),
    (
        "housing at 0.5 m/s², 1 Hz",
        {"housing": {"harmonic": {"amplitude_m_s2": 0.5, "frequency_hz": 1.0}}},
    ),
    # A foot of 1 kg; at a lever of 0.1 m a tensed ankle of 500 N m/rad, and a loose one of 100.
    ("wearer on 50 kN/m", {"wearer": {"plate_kg": 1.0, "ankle_n_m": 5e4, "ankle_n_s_m": 100.0}}),
    ("wearer on 10 kN/m", {"wearer": {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}}),
)
"""The first is what the others are compared with."""

QUICK_PARTS = 3


class Rig(NamedTuple):
    """A module in motion; `integral` is the speed loop's, shape (1,)."""

    parts: Parts
    probe: Probe
    memory: Memory
    natural_rad_s: float
    integral: np.ndarray[Any, np.dtype[np.float64]]


def scene_with(changes: Mapping[str, Any]) -> Scene:
    """table1 on its impact orbit, with some tables replaced or added."""
    return load_scene({**copy.deepcopy(read_scene("table1-viscous")), **ORBIT, **changes})


def rig_of(scene: Scene) -> Rig:
    """The scene's module at its start, its crank at speed."""
    parts = scene.parts()
    speed_rad_s = RATIO * scene.natural_rad_s
    start = replace(initial_state(scene), omega_rad_s=speed_rad_s)
    memory = allocate(parts, start, scene.solver.accuracy, IMPACTS_AT_ONCE)
    probe: Probe = NoSensing()
    if scene.sensors is not None:
        probe = allocate_sensing(scene.sensors.models(), speed_rad_s, parts.housing)
    return Rig(parts, probe, memory, scene.natural_rad_s, np.array([LOOP_START_N_M]))


def carry_on(
    rig: Rig, ratio: float, periods: int, held: bool = False
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """So many periods of the drive at a speed; the impacts on the way, shape (impacts, 6).

    `held` leaves a motor's speed loop out: its torque stays what it was in the mean.
    """
    speed_rad_s = ratio * rig.natural_rad_s
    end_s = float(rig.memory.held[ELAPSED]) + periods * 2.0 * math.pi / speed_rad_s
    drive = rig.parts.drive
    if isinstance(drive, IdealDrive):
        parts = rig.parts._replace(drive=drive._replace(omega_rad_s=speed_rad_s))
        return run(parts, rig.probe, rig.memory, 0.0, 0.0, end_s, NO_GRID, NO_SAMPLES)
    if held:
        mean_n_m = float(rig.integral[0])
        return run(rig.parts, rig.probe, rig.memory, mean_n_m, 0.0, end_s, NO_GRID, NO_SAMPLES)
    rows = []
    while rig.memory.held[ELAPSED] < end_s:
        error = speed_rad_s - rig.memory.y[3]
        rig.integral[0] += LOOP_N_M * error * LOOP_S
        torque_n_m = LOOP_N_M_S * error + float(rig.integral[0])
        until_s = min(float(rig.memory.held[ELAPSED]) + LOOP_S, end_s)
        rows.append(run(rig.parts, rig.probe, rig.memory, torque_n_m, 0.0, until_s, NO_GRID, NO_SAMPLES))
    return np.concatenate(rows)


def fold_of(rig: Rig, ratio: float) -> float:
    """The largest r, in steps of FOLD_STEP, at which the blows go on; `rig` strikes at `ratio`."""
    while ratio < FASTEST:
        faster = ratio + FOLD_STEP
        carry_on(rig, faster, 3 * FOLD_PERIODS // 4)
        if len(carry_on(rig, faster, FOLD_PERIODS // 4)) == 0:
            break
        ratio = faster
    return round(ratio, 2)


def measure(quick: bool, repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Rows for every part: cost, impulse, peak force, energy per cycle and fold; the first is the measure."""
    chosen = PARTS[:QUICK_PARTS] if quick else PARTS
    scenes = [(name, scene_with(changes)) for name, changes in chosen]
    rows = []
    for name, scene in scenes:
        progress(name)
        rows.append({"what": f"part: {name}", "kind": "part", **figures_of(scene)})
    spent: list[list[float]] = [[] for _ in scenes]
    for _ in range(repeats):
        for index, (_, scene) in enumerate(scenes):
            rig = rig_of(scene)
            carry_on(rig, RATIO, SETTLE_PERIODS)
            begun_s = float(rig.memory.held[ELAPSED])
            begun = time.thread_time_ns()
            carry_on(rig, RATIO, LOOK_PERIODS, held=True)
            spent_us = (time.thread_time_ns() - begun) * 1e-3
            spent[index].append(spent_us / (float(rig.memory.held[ELAPSED]) - begun_s))
    for row, times in zip(rows, spent, strict=True):
        row.update(
            cost=min(times),
            cost_median=statistics.median(times),
            cost_ratio=min(times) / min(spent[0]),
            error=abs(row["impulse_n_s"] / rows[0]["impulse_n_s"] - 1.0),
            unit=f"share of the first part's impulse; {COST_UNIT}",
        )
    return rows


def figures_of(scene: Scene) -> dict[str, Any]:
    """What the orbit looks like with these parts."""
    rig = rig_of(scene)
    carry_on(rig, RATIO, SETTLE_PERIODS)
    work = work_place(rig.parts)
    before_j = float(rig.memory.y[work])
    impacts = carry_on(rig, RATIO, LOOK_PERIODS)
    energy_j = (float(rig.memory.y[work]) - before_j) / LOOK_PERIODS
    felt_n = peak_felt_force_n(rig.parts, rig.memory)
    return {
        "impulse_n_s": _mean(impacts[:, IMPULSE]),
        "peak_force_n": _mean(impacts[:, PEAK_FORCE]),
        "peak_felt_force_n": math.nan if felt_n is None else felt_n,
        "impacts_per_period": len(impacts) / LOOK_PERIODS,
        "energy_per_cycle_j": energy_j,
        "fold_r": fold_of(rig, RATIO) if len(impacts) else fold_from_resonance(scene),
    }


def fold_from_resonance(scene: Scene) -> float:
    """The same for a module whose blows have ended at RATIO already: it strikes at resonance first."""
    rig = rig_of(scene)
    carry_on(rig, 1.0, SETTLE_PERIODS)
    return fold_of(rig, 1.0)


def _mean(values: Any) -> float:
    return float(np.mean(values)) if len(values) else math.nan
