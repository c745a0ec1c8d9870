"""Cost and effect of each part of a scene: one impact orbit, one part changed at a time.

The orbit is table1's at r = 1.3. Its fold is the ratio at which the impacts end as the crank's speed is
increased in steps. A motor is held at speed by a PI loop; the time of the kernel calls alone is subtracted
from its cost.
"""

import copy
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from plant_sim.parts.drive import IdealDrive
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import Scene, load_scene, read_scene
from plant_sim.simulation import initial_state
from tools.trade.costs import COST_UNIT, Progress, interleave, mean

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

STOPS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("Hunt–Crossley, 10 ms", {}),
    ("rigid", {"stop": RIGID}),
    ("Kelvin–Voigt, 10 ms", {"stop": {**HERTZ, "law": "kelvin-voigt"}}),
    *(
        (f"Hunt–Crossley, {1e3 * contact_s:g} ms", {"stop": {**HERTZ, "contact_s": contact_s}})
        for contact_s in (0.002, 0.005, 0.03)
    ),
)
"""Models of the stop; the first, the bench's own, is the reference for the others."""

CHANGES = {"part": PARTS, "fidelity": STOPS}
"""What the rows of each kind change."""

QUICK_ROWS = 3


def scene_with(changes: Mapping[str, Any]) -> Scene:
    """Return the scene table1 on its impact orbit, with some tables replaced or added."""
    return load_scene({**copy.deepcopy(read_scene("table1-viscous")), **ORBIT, **changes})


class Module:
    """A scene's module whose crank is kept at a speed: an ideal drive turns at it, a motor by a PI loop."""

    def __init__(self, scene: Scene) -> None:
        """Start in the scene's initial state, with the crank at speed."""
        self.natural_rad_s = scene.natural_rad_s
        start = replace(initial_state(scene), omega_rad_s=RATIO * self.natural_rad_s)
        self.plant = Plant(scene, seed=1, initial=start)
        self.torque_n_m = LOOP_START_N_M
        """Integral of the speed loop."""

    def carry_on(self, ratio: float, periods: int) -> list[Impact]:
        """Advance by a number of drive periods at a speed, and return the impacts."""
        speed_rad_s, parts = ratio * self.natural_rad_s, self.plant.parts
        left_s = periods * 2.0 * math.pi / speed_rad_s
        if isinstance(parts.drive, IdealDrive):
            if parts.drive.omega_rad_s != speed_rad_s:
                drive = parts.drive._replace(omega_rad_s=speed_rad_s)
                self.plant.replace_parts(parts._replace(drive=drive))
            self.plant.advance(0.0, left_s)
        else:
            while left_s > 0.0:
                error_rad_s = speed_rad_s - self.plant.now.omega_rad_s
                self.torque_n_m += LOOP_N_M * error_rad_s * LOOP_S
                self.plant.advance(LOOP_N_M_S * error_rad_s + self.torque_n_m, min(LOOP_S, left_s))
                left_s -= LOOP_S
        return self.plant.take_impacts()


def settle(scene: Scene, ratio: float = RATIO) -> Module:
    """Return the scene's module after SETTLE_PERIODS at a speed."""
    module = Module(scene)
    module.carry_on(ratio, SETTLE_PERIODS)
    return module


def spent_us_s(scene: Scene) -> float:
    """Return the processor time per simulated second, µs, without the time of the calls alone."""
    module = settle(scene)
    begun_s, begun = module.plant.t_s, time.thread_time_ns()
    module.carry_on(RATIO, LOOK_PERIODS)
    ended = time.thread_time_ns()
    lasted_s = module.plant.t_s - begun_s
    for _ in range(1 if isinstance(module.plant.parts.drive, IdealDrive) else math.ceil(lasted_s / LOOP_S)):
        module.plant.advance(module.torque_n_m, 0.0)
    calls = time.thread_time_ns() - ended
    return (ended - begun - calls) * 1e-3 / lasted_s


def fold_of(module: Module, ratio: float) -> float:
    """Return the largest r, in steps of FOLD_STEP, at which impacts last; the module has some at `ratio`."""
    while ratio < FASTEST:
        faster = ratio + FOLD_STEP
        module.carry_on(faster, 3 * FOLD_PERIODS // 4)
        if not module.carry_on(faster, FOLD_PERIODS // 4):
            break
        ratio = faster
    return round(ratio, 2)


def measure(kind: str, quick: bool, repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Return a row for each change of this kind: cost, impulse, peak force, energy per cycle and fold.

    The first row is the reference for the errors and the cost ratios.
    """
    chosen = CHANGES[kind][: QUICK_ROWS if quick else None]
    scenes = [(name, scene_with(changes)) for name, changes in chosen]
    rows = []
    for name, scene in scenes:
        progress(name)
        rows.append({"what": f"{kind}: {name}", "kind": kind, **figures_of(scene)})
    times = interleave([partial(spent_us_s, scene) for _, scene in scenes], repeats)
    for row, least in zip(rows, times, strict=True):
        row.update(
            cost=least,
            cost_ratio=least / times[0],
            error=abs(row["impulse_n_s"] / rows[0]["impulse_n_s"] - 1.0),
            unit=f"share of the impulse in the first row; {COST_UNIT}",
        )
    return rows


def figures_of(scene: Scene) -> dict[str, Any]:
    """Return the figures of the orbit with these parts."""
    module = settle(scene)
    plant = module.plant
    drive_j, terminals = plant.energy.drive_work_j, plant.electrical
    impacts = module.carry_on(RATIO, LOOK_PERIODS)
    terminal_j = math.nan
    if terminals is not None and plant.electrical is not None:
        terminal_j = (plant.electrical.work_j - terminals.work_j) / LOOK_PERIODS
    felt_n = plant.peak_felt_force_n
    return {
        "impulse_n_s": mean([impact.impulse_n_s for impact in impacts]),
        "peak_force_n": mean([impact.peak_force_n for impact in impacts]),
        "peak_felt_force_n": math.nan if felt_n is None else felt_n,
        "approach_m_s": mean([impact.v_m_s for impact in impacts]),
        "impacts_per_period": len(impacts) / LOOK_PERIODS,
        "energy_per_cycle_j": (plant.energy.drive_work_j - drive_j) / LOOK_PERIODS,
        "terminal_energy_per_cycle_j": terminal_j,
        # Without impacts at RATIO, the fold is reached from the impacts at resonance.
        "fold_r": fold_of(module, RATIO) if impacts else fold_of(settle(scene, 1.0), 1.0),
    }
