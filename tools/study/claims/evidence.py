"""The evidence for the claims: sweeps, basins, impacts on soft stops, starts. Each is computed once."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from plant_sim.plant import Plant
from plant_sim.result import MotionState, Phase
from plant_sim.scene import Scene
from tools.study import basin, work
from tools.study.cases import DRY_RANGE, LAWS, PRESETS, VISCOUS_RANGE_N_S_M, Case, case, whole_range
from tools.study.orbits import AT_REST, PAPER, Outcome, Protocol, State, classify, follow
from tools.study.portraits import sample
from tools.study.sweep import RATIOS, Diagram, diagrams, follow_on, row_of

CONTACTS_S = (0.01, 0.03, 0.05)
"""Elastic contact times of the bench's elastomer pad and of two softer pads."""

SOFT_RATIOS = (1.0, 1.05, 1.1, 1.2, 1.3)

PHASES = 32
"""Number of crank angles at which starts are tried."""

RAMP_STEPS_PER_S = 100
"""Steps of constant speed in a ramp, 10 ms each; the crank turns by at most 8° in a step."""

LONGEST_CONTACT_S = 0.15
HIGHEST_PEAK_N = 40.0

SETTLED = Protocol(settle_s=280.0, record_s=20.0, tolerance=1e-6, looks=64)

BASIN_SIZE = 300


@dataclass(frozen=True)
class Evidence:
    """Evidence that is computed at first use and then kept."""

    where: work.Where
    ratios: int = RATIOS
    """Number of ratios of a sweep."""

    @cached_property
    def diagrams(self) -> dict[Case, Diagram]:
        """Diagrams of both presets over Table 1's ranges of b and μ, by their cases.

        Coulomb–Stribeck friction with the retuned spring is slow to compute: only its nominal μ is included.
        One more diagram has viscous friction with the amplitude of the dry laws.
        """
        cases = [
            one
            for one in whole_range(PRESETS, LAWS)
            if (one.preset, one.law) != ("gait", "stribeck") or one.mu == DRY_RANGE[0]
        ]
        same_amplitude = replace(case("table1", "viscous"), amplitude_m=0.03)
        found = diagrams([*cases, same_amplitude], self.where, self.ratios)
        return {diagram.case: diagram for diagram in found}

    def nominal(self, preset: str) -> list[Diagram]:
        """Return the diagrams of a preset's nominal case with each law."""
        return [self.diagrams[case(preset, law)] for law in LAWS]

    @cached_property
    def soft(self) -> dict[Case, list[dict[str, Any]]]:
        """Rows of run-ups on soft stops, for several contact times and damping coefficients."""
        cases = [
            soft_case(preset, contact_s, b)
            for preset in PRESETS
            for contact_s in CONTACTS_S
            for b in (VISCOUS_RANGE_N_S_M if contact_s == CONTACTS_S[1] else VISCOUS_RANGE_N_S_M[1:2])
        ]
        return dict(zip(cases, work.run("soft", soft_run_up, cases, self.where), strict=True))

    @cached_property
    def contacts(self) -> dict[tuple[str, float], float]:
        """Elastic contact times, s, for which the peak force is the paper's 40 N, by preset and ratio."""
        keys = [(preset, ratio) for preset in PRESETS for ratio in SOFT_RATIOS[:3]]
        return dict(zip(keys, work.run("contact", contact_for_peak_s, keys, self.where), strict=True))

    def peak_n(self, preset: str, contact_s: float, ratio: float, b_n_s_m: float = 0.2) -> float:
        """Return the peak force of the settled motion on a soft stop, N; nan without impacts."""
        rows = self.soft[soft_case(preset, contact_s, b_n_s_m)]
        return next(float(row["peak_n"]) for row in rows if row["ratio"] == ratio)

    def basin(self, law: str) -> basin.Basin:
        """Return the basin in the plane (x0, v0) in the middle of the multistable band."""
        one = case("table1", law)
        return basin.compute(one, self.diagrams[one].two_motions_r(), "state", BASIN_SIZE, self.where)


def soft_case(preset: str, contact_s: float, b_n_s_m: float) -> Case:
    """Return a preset's module with viscous friction and a soft stop of this elastic contact time."""
    return replace(case(preset, "viscous", b_n_s_m), contact_s=contact_s)


def soft_run_up(one: Case) -> list[dict[str, Any]]:
    """Compute a run-up in steps of 0.05 in r; return the rows of SOFT_RATIOS."""
    ratios = np.round(np.arange(0.85, SOFT_RATIOS[-1] + 0.01, 0.05), 2)
    outcomes = zip(ratios, follow_on(one, ratios, PAPER), strict=True)
    return [row_of(ratio, outcome) for ratio, outcome in outcomes if ratio in SOFT_RATIOS]


def grazing_amplitude_m(one: Case, ratio: float) -> float:
    """Return the drive amplitude, m, at which the non-impact motion just reaches the stop."""
    free = replace(one, stop_m=one.rest_length_m + 10.0)

    def beyond_m(amplitude_m: float) -> float:
        scene = replace(free, amplitude_m=amplitude_m).scene(ratio)
        return follow(scene, AT_REST, SETTLED).x_high_m - one.stop_m

    return float(brentq(beyond_m, 0.0, 0.2))


def contact_for_peak_s(preset_and_ratio: tuple[str, float]) -> float:
    """Return the elastic contact time for which the peak force is 40 N, s; nan if there is none."""
    preset, ratio = preset_and_ratio
    one, low, high = case(preset, "viscous"), 0.005, LONGEST_CONTACT_S
    if not run_up(replace(one, contact_s=high), ratio).peak_n <= HIGHEST_PEAK_N:
        return math.nan
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        softer = run_up(replace(one, contact_s=middle), ratio).peak_n > HIGHEST_PEAK_N
        low, high = (middle, high) if softer else (low, middle)
    return math.sqrt(low * high)


def run_up(one: Case, ratio: float) -> Outcome:
    """Return the motion at a ratio, reached from r = 0.95 in steps of 0.1 or less."""
    steps = max(1, math.ceil((ratio - 0.95) / 0.1))
    *_, last = follow_on(one, (0.95 + (ratio - 0.95) * step / steps for step in range(steps + 1)), SETTLED)
    return last


def share_from_rest(one: Case, ratio: float) -> float:
    """Return the share of crank angles from which a start at rest, at full speed, leads to impact motion."""
    starts = np.zeros((PHASES, 3))
    starts[:, 2] = np.linspace(0.0, 2.0 * math.pi, PHASES, endpoint=False)
    return float((classify(one.scene(ratio), starts)[1] > 0.0).mean())


def share_after_ramp(one: Case, ratio: float, duration_s: float) -> float:
    """Return the share of crank angles from which a ramp from standstill leads to impact motion."""
    scene = one.scene(ratio)
    ends = [
        after_ramp(scene, crank_rad, duration_s)
        for crank_rad in np.linspace(0.0, 2.0 * math.pi, PHASES, endpoint=False)
    ]
    return float((classify(scene, np.array(ends))[1] > 0.0).mean())


def after_ramp(scene: Scene, crank_rad: float, duration_s: float) -> State:
    """Return the state after a run-up from rest at a relaxed spring to the drive's speed.

    The speed rises as an S, 3 u² − 2 u³, in steps of constant speed.
    """
    rest_m, steps = scene.striker.rest_length_m, math.ceil(RAMP_STEPS_PER_S * duration_s)
    plant = Plant(scene, seed=0, initial=MotionState(0.0, rest_m, 0.0, crank_rad, 0.0, Phase.FLIGHT))
    drive: Any = plant.parts.drive
    for u in (np.arange(steps) + 0.5) / steps:
        turning = drive._replace(omega_rad_s=drive.omega_rad_s * u * u * (3.0 - 2.0 * u))
        plant.replace_parts(plant.parts._replace(drive=turning))
        plant.advance(0.0, duration_s / steps)
    return State(plant.now.x_m - rest_m, plant.now.v_m_s, plant.now.crank_rad)


def cycle_shape(one: Case, ratio: float, start: State) -> NDArray[np.float64]:
    """Return x over one drive period from its largest value on, with zero mean and unit variance."""
    turn_s = 2.0 * math.pi / (ratio * one.natural_rad_s)
    x_m = sample(one, ratio, start, np.linspace(0.0, 2.0 * turn_s, 1201)).x_m
    first = int(np.argmax(x_m[:600]))
    cycle = x_m[first : first + 600]
    shape: NDArray[np.float64] = (cycle - cycle.mean()) / cycle.std()
    return shape
