"""Time histories and phase portraits of impact and non-impact motion of a case, with Poincaré points."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant_sim.result import MotionState, Phase, SimulationResult
from plant_sim.solvers.adaptive import adaptive
from tools.study.cases import Case
from tools.study.orbits.follow import State, follow
from tools.study.orbits.sections import PAPER, SECTION_RAD
from tools.study.sweep import Diagram, end_state

SHOWN_PERIODS = 4
SECTIONS = 60
"""Number of Poincaré points: passages of the crank through its backward dead centre, a period's beginning."""

SAMPLES_PER_PERIOD = 400
ACCURACY_M = 1e-9


@dataclass(frozen=True)
class Motion:
    """Some periods of a settled motion, with states before and after each impact, and its Poincaré points."""

    case: Case
    ratio: float
    reaches_stop: bool
    t_s: NDArray[np.float64]
    x_m: NDArray[np.float64]
    v_m_s: NDArray[np.float64]
    points: NDArray[np.float64]
    """Poincaré points, shape (SECTIONS, 2): x, v."""


@dataclass(frozen=True)
class Pair:
    """The impact and the non-impact motion of a case; None if the motion does not exist."""

    case: Case
    impact: Motion | None
    non_impact: Motion | None


def pair(diagram: Diagram) -> Pair:
    """Return both motions at the middle of the widest multistable band; if none, the motion at r = 1.5."""
    band = diagram.widest_multistable()
    if band is not None:
        ratio = round(0.5 * (band[0] + band[1]), 2)
        return Pair(
            diagram.case,
            motion(diagram.case, ratio, diagram.up.state_at(ratio)),
            motion(diagram.case, ratio, diagram.down.state_at(ratio)),
        )
    non_impact = 1.5
    return Pair(diagram.case, None, motion(diagram.case, non_impact, diagram.up.state_at(non_impact)))


def motion(case: Case, ratio: float, start: State) -> Motion:
    """Return the settled motion from a start, sampled over SHOWN_PERIODS."""
    settled = end_state(follow(case, ratio, start, PAPER))
    turn_s = 2.0 * math.pi / (ratio * case.natural_rad_s)
    shown = sample(
        case, ratio, settled, np.linspace(0.0, SHOWN_PERIODS * turn_s, SHOWN_PERIODS * SAMPLES_PER_PERIOD)
    )
    to_section_s = ((SECTION_RAD - settled.crank_rad) % (2.0 * math.pi)) / (ratio * case.natural_rad_s)
    sections = sample(case, ratio, settled, to_section_s + turn_s * np.arange(float(SECTIONS)))
    t_s, x_m, v_m_s = with_impacts(case, shown)
    if sections.samples is None:
        raise AssertionError("a run with sample times has samples")
    points = np.column_stack((sections.samples.x_m, sections.samples.v_m_s))
    return Motion(case, ratio, len(shown.impacts.t_s) > 0, t_s, x_m, v_m_s, points)


def sample(case: Case, ratio: float, start: State, t_s: NDArray[np.float64]) -> SimulationResult:
    """Simulate the motion from a start and sample it at the given times."""
    initial = MotionState(
        0.0,
        min(start.y_m + case.rest_length_m, case.stop_m),
        start.v_m_s,
        start.crank_rad,
        ratio * case.natural_rad_s,
        Phase.FLIGHT,
    )
    parts = case.scene(ratio).parts()
    return adaptive.simulate(parts, initial, float(t_s[-1]), t_s, accuracy=ACCURACY_M)


def with_impacts(
    case: Case, result: SimulationResult
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return t, x and v of the samples, with the states just before and after each impact inserted."""
    samples, impacts = result.samples, result.impacts
    if samples is None:
        raise AssertionError("a run with sample times has samples")
    stop = np.full(len(impacts.t_s), case.stop_m)
    t_s = np.concatenate((samples.t_s, impacts.t_s, impacts.t_s))
    x_m = np.concatenate((samples.x_m, stop, stop))
    v_m_s = np.concatenate((samples.v_m_s, impacts.v_m_s, impacts.v_after_m_s))
    order = np.argsort(t_s, kind="stable")
    return t_s[order], x_m[order], v_m_s[order]
