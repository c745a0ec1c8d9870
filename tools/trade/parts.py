"""Cost and effect of each part of a scene: one impact orbit, one part changed at a time.

The orbit is table1's at r = 1.3. Its fold is the ratio at which the impacts end as the crank's speed is
increased in steps. A motor is held at speed by a PI loop; the time of the kernel calls alone is subtracted
from its cost.
"""

import copy
import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import entry_point
from plant_sim.kinds import kernel_parts, kernel_probe
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.references import by_reference
from plant_sim.scene import Scene, load_scene, read_scene
from plant_sim.sensors.sensing import NoSensing, Probe, allocate_sensing, series_order
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive.adaptive import DONE, IMPACTS_AT_ONCE, NO_GRID, advance, refusal
from plant_sim.solvers.adaptive.observation import electrical_ledger, peak_felt_force_n
from plant_sim.solvers.adaptive.state_layout import Memory, allocate, work_place
from tools.trade.costs import COST_UNIT, Progress, mean

RATIO = 1.3
SETTLE_PERIODS, LOOK_PERIODS = 60, 60
FOLD_PERIODS = 40
"""Periods at each speed on the way to the fold; there must be impacts in the last quarter."""
FOLD_STEP = 0.01
FASTEST = 2.0

LOOP_S = 5e-3
"""Period of the speed loop, s. Below: its gains (they hold r = 1.3 with 3 % of ripple), its first torque."""
LOOP_N_M_S, LOOP_N_M, LOOP_START_N_M = 0.05, 0.3, 0.06

RIGID = {"law": "rigid", "position_m": 0.18, "restitution": 0.5}
HERTZ = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}

# State just after separation, the crank 27° past its forward dead centre: the orbit with one impact a period.
ORBIT: dict[str, Any] = {
    "drive": {"model": "ideal", "amplitude_m": 0.02, "ratio": RATIO, "phase_rad": 2.04},
    "stop": HERTZ,
    "initial": {"x_m": 0.1799, "v_m_s": -0.455},
}

MOTOR = {"model": "motor", "amplitude_m": 0.02, "phase_rad": 2.04}
DQ_MOTOR = {**MOTOR, "model": "dq-motor"}

PARTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("viscous, ideal, Hunt–Crossley", {}),
    ("no friction", {"friction": {"law": "none"}}),
    # Dry friction with about the force of viscous friction: μ m g = 0.16 N, b v⁻ = 0.18 N.
    ("Coulomb, μ = 0.02", {"friction": {"law": "coulomb", "mu": 0.02}}),
    (
        "Stribeck, μ = 0.02, μ_s 0.03",
        {"friction": {"law": "stribeck", "mu": 0.02, "mu_s": 0.03, "v_s_m_s": 0.05, "delta": 1.0}},
    ),
    ("rigid stop", {"stop": RIGID}),
    ("Kelvin–Voigt, 10 ms", {"stop": {**HERTZ, "law": "kelvin-voigt"}}),
    ("motor at speed", {"drive": MOTOR}),
    ("d-q motor at speed", {"drive": DQ_MOTOR}),
    ("sensors", {"sensors": {}}),
    ("rod of 60 mm", {"drive": {**ORBIT["drive"], "rod_m": 0.06}}),
    ("tilt of 0.1 rad uphill", {"housing": {"tilt_rad": 0.1}}),
    ("housing at 0.5 m/s², 1 Hz", {"housing": {"harmonic": {"amplitude_m_s2": 0.5, "frequency_hz": 1.0}}}),
    # A foot of 1 kg with a lever arm of 0.1 m: a tensed ankle of 500 N m/rad, a relaxed ankle of 100 N m/rad.
    ("wearer on 50 kN/m", {"wearer": {"plate_kg": 1.0, "ankle_n_m": 5e4, "ankle_n_s_m": 100.0}}),
    ("wearer on 10 kN/m", {"wearer": {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}}),
)
"""Parts as changes of the scene; the first is the reference for the others."""

QUICK_PARTS = 3


class Rig(NamedTuple):
    """A module in motion; `integral` is the speed loop's integral, shape (1,), `kernel` the machine code."""

    parts: Parts
    probe: Probe
    memory: Memory
    natural_rad_s: float
    integral: np.ndarray[Any, np.dtype[np.float64]]
    kernel: Callable[..., int]


def scene_with(changes: Mapping[str, Any]) -> Scene:
    """Return the scene table1 on its impact orbit, with some tables replaced or added."""
    return load_scene({**copy.deepcopy(read_scene("table1-viscous")), **ORBIT, **changes})


def rig_of(scene: Scene) -> Rig:
    """Return the scene's module at its initial state, with the crank at speed."""
    parts = scene.parts()
    speed_rad_s = RATIO * scene.natural_rad_s
    start = replace(initial_state(scene), omega_rad_s=speed_rad_s)
    probe: Probe = NoSensing()
    if scene.sensors is not None:
        probe = allocate_sensing(scene.sensors, speed_rad_s, parts.housing)
    memory = allocate(parts, start, scene.solver.accuracy, IMPACTS_AT_ONCE, series_order(probe))
    probe, own_memory = kernel_probe(probe), by_reference(memory)
    kernel = entry_point(advance, kernel_parts(parts), probe, own_memory, 0.0, 0.0, 0.0, NO_GRID)
    return Rig(parts, probe, own_memory, scene.natural_rad_s, np.array([LOOP_START_N_M]), kernel)


def carry_on(rig: Rig, ratio: float, periods: int) -> NDArray[np.void]:
    """Advance by a number of drive periods at a speed; return the impacts as records of `Impact`."""
    speed_rad_s = ratio * rig.natural_rad_s
    now_s = float(rig.memory.held[0].elapsed_s)
    end_s = now_s + periods * 2.0 * math.pi / speed_rad_s
    drive = rig.parts.drive
    if isinstance(drive, IdealDrive):
        _advance(rig, rig.parts._replace(drive=drive._replace(omega_rad_s=speed_rad_s)), 0.0, end_s)
    else:
        while now_s < end_s:
            error = speed_rad_s - rig.memory.y[3]
            rig.integral[0] += LOOP_N_M * error * LOOP_S
            torque_n_m = LOOP_N_M_S * error + float(rig.integral[0])
            now_s = min(now_s + LOOP_S, end_s)
            _advance(rig, rig.parts, torque_n_m, now_s)
    impacts: NDArray[np.void] = rig.memory.impacts[: rig.memory.mode[0].impacts].copy()
    rig.memory.mode[0].impacts = 0
    return impacts


def settled(scene: Scene, ratio: float = RATIO) -> Rig:
    """Return the scene's module after SETTLE_PERIODS at a speed."""
    rig = rig_of(scene)
    carry_on(rig, ratio, SETTLE_PERIODS)
    return rig


def _advance(rig: Rig, parts: Parts, torque_n_m: float, until_s: float) -> None:
    status = rig.kernel(kernel_parts(parts), rig.probe, rig.memory, torque_n_m, 0.0, until_s, NO_GRID)
    if status != DONE:
        raise refusal(status, parts, rig.memory, 0.0)


def spent_us_s(rig: Rig) -> float:
    """Return the processor time per simulated second, µs, without the time of the kernel calls alone."""
    begun_s, begun = float(rig.memory.held[0].elapsed_s), time.thread_time_ns()
    carry_on(rig, RATIO, LOOK_PERIODS)
    ended = time.thread_time_ns()
    lasted_s = float(rig.memory.held[0].elapsed_s) - begun_s
    calls = 1 if isinstance(rig.parts.drive, IdealDrive) else math.ceil(lasted_s / LOOP_S)
    for _ in range(calls):
        _advance(rig, rig.parts, float(rig.integral[0]), begun_s + lasted_s)
    empty = time.thread_time_ns() - ended
    return (ended - begun - empty) * 1e-3 / lasted_s


def fold_of(rig: Rig, ratio: float) -> float:
    """Return the largest r, in steps of FOLD_STEP, at which impacts last; `rig` has impacts at `ratio`."""
    while ratio < FASTEST:
        faster = ratio + FOLD_STEP
        carry_on(rig, faster, 3 * FOLD_PERIODS // 4)
        if len(carry_on(rig, faster, FOLD_PERIODS // 4)) == 0:
            break
        ratio = faster
    return round(ratio, 2)


def measure(quick: bool, repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Return a row for each part: cost, impulse, peak force, energy per cycle and fold.

    The first part is the reference for the errors and the cost ratios.
    """
    chosen = PARTS[:QUICK_PARTS] if quick else PARTS
    scenes = [(name, scene_with(changes)) for name, changes in chosen]
    rows = []
    for name, scene in scenes:
        progress(name)
        rows.append({"what": f"part: {name}", "kind": "part", **figures_of(scene)})
    rounds = [[spent_us_s(settled(scene)) for _, scene in scenes] for _ in range(repeats)]
    spent = list(zip(*rounds, strict=True))
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
    """Return the figures of the orbit with these parts."""
    rig = settled(scene)
    work = work_place(rig.parts)
    before_j = float(rig.memory.y[work])
    terminals_before = electrical_ledger(rig.parts, rig.memory)
    impacts = carry_on(rig, RATIO, LOOK_PERIODS)
    energy_j = (float(rig.memory.y[work]) - before_j) / LOOK_PERIODS
    terminals = electrical_ledger(rig.parts, rig.memory)
    terminal_j = math.nan
    if terminals is not None and terminals_before is not None:
        terminal_j = (terminals.work_j - terminals_before.work_j) / LOOK_PERIODS
    felt_n = peak_felt_force_n(rig.parts, rig.memory)
    return {
        "impulse_n_s": mean(impacts["impulse_n_s"]),
        "peak_force_n": mean(impacts["peak_force_n"]),
        "peak_felt_force_n": math.nan if felt_n is None else felt_n,
        "impacts_per_period": len(impacts) / LOOK_PERIODS,
        "energy_per_cycle_j": energy_j,
        "terminal_energy_per_cycle_j": terminal_j,
        "fold_r": fold_of(rig, RATIO) if len(impacts) else fold_from_resonance(scene),
    }


def fold_from_resonance(scene: Scene) -> float:
    """Return the fold of a module that has no impacts at RATIO, starting from its impacts at resonance."""
    return fold_of(settled(scene, 1.0), 1.0)
