"""Time histories and phase portraits of impact and non-impact motion of a case, with Poincaré points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant_sim.result import Samples
from plant_sim.solvers.double_double import TURN_RAD
from tools.study.cases import Case
from tools.study.orbits import PAPER, SECTION_RAD, State, follow
from tools.study.orbits import motion as simulated
from tools.study.sweep import Diagram

SHOWN_PERIODS = 4
SECTIONS = 60
"""Number of Poincaré points: passages of the crank through its backward dead centre, a period's beginning."""

SAMPLES_PER_PERIOD = 400
ACCURACY_M = 1e-9


@dataclass(frozen=True)
class Motion:
    """Some periods of a settled motion, and its Poincaré points."""

    case: Case
    ratio: float
    samples: Samples
    points: Samples
    """Poincaré points: SECTIONS of them."""


def both_motions(diagram: Diagram) -> tuple[Motion, Motion]:
    """Return impact and non-impact motion in the middle of the widest multistable band."""
    case, ratio = diagram.case, diagram.two_motions_r()
    starts = diagram.up.state_at(ratio), diagram.down.state_at(ratio)
    return motion(case, ratio, starts[0]), motion(case, ratio, starts[1])


def motion(case: Case, ratio: float, start: State) -> Motion:
    """Return the settled motion from a start, sampled over SHOWN_PERIODS."""
    settled = follow(case.scene(ratio), start, PAPER).end
    drive_rad_s = ratio * case.natural_rad_s
    turn_s, to_section_rad = TURN_RAD / drive_rad_s, (SECTION_RAD - settled.crank_rad) % TURN_RAD
    shown_s = np.linspace(0.0, SHOWN_PERIODS * turn_s, SHOWN_PERIODS * SAMPLES_PER_PERIOD)
    sections_s = to_section_rad / drive_rad_s + turn_s * np.arange(float(SECTIONS))
    return Motion(case, ratio, *(sample(case, ratio, settled, times_s) for times_s in (shown_s, sections_s)))


def sample(case: Case, ratio: float, start: State, t_s: NDArray[np.float64]) -> Samples:
    """Simulate the motion from a start and sample it at the given times."""
    samples = simulated(case.scene(ratio), start, float(t_s[-1]), t_s, ACCURACY_M).samples
    assert samples is not None  # for a run with sample times
    return samples
