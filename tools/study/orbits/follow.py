"""Orbits of a case, by the closed-form solution if there is one, otherwise by the adaptive solver."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import entry_point, jit
from plant_sim.result import MotionState, Phase
from plant_sim.scene import Scene
from plant_sim.solvers.adaptive.state_layout import allocate
from tools.study.cases import Case
from tools.study.orbits import sections
from tools.study.orbits.closed import closed
from tools.study.orbits.sections import Carrier, Outcome, Periods, Protocol
from tools.study.orbits.stepwise import stepwise

ACCURACY_M = 1e-7
"""Accuracy of the adaptive solver per period, m: about a millionth of the gap."""

IMPACTS_AT_ONCE = 256


class State(NamedTuple):
    """State of the module: position less rest length, velocity, crank angle."""

    y_m: float
    v_m_s: float
    crank_rad: float


AT_REST = State(0.0, 0.0, 0.0)


class Advanced(NamedTuple):
    """y = x − l0 and v at the end of a motion, nan if the solver fails, and a number of impacts."""

    y_m: float
    v_m_s: float
    impacts: int


FOLLOW = jit(sections.follow_orbit)


def follow(case: Case, ratio: float, start: State, protocol: Protocol) -> Outcome:
    """Return the outcome of one start."""
    return follow_orbit(carrier_of(case.scene(ratio)), start, protocol)


def follow_orbit(carrier: Carrier, start: State, protocol: Protocol) -> Outcome:
    """Return the outcome of one start, followed by a carrier."""
    arguments = carrier, *start, protocol, *sections.new_rows(protocol, carrier.size.drive_rad_s)
    return entry_point(FOLLOW, *arguments)(*arguments)


def advance(carrier: Carrier, start: State, until_s: float, counted_from_s: float = 0.0) -> Advanced:
    """The state of a start at `until_s`, and the impacts from `counted_from_s` on."""
    arguments = carrier, *start, float(counted_from_s), float(until_s), np.zeros(1, sections.PERIOD)
    return Advanced(*entry_point(_advance, *arguments)(*arguments))


@jit
def _advance(
    carrier: Carrier,
    y_m: float,
    v_m_s: float,
    crank_rad: float,
    counted_from_s: float,
    until_s: float,
    rows: Periods,
) -> tuple[float, float, int]:
    motion = sections.set_out(carrier, y_m, v_m_s, crank_rad)
    motion, lost = sections.carry(carrier, motion, counted_from_s, False, rows[0])
    motion, lost_later = sections.carry(carrier, motion, until_s, False, rows[0])
    if lost or lost_later:
        return math.nan, math.nan, 0
    y_m, v_m_s, _ = sections.section(carrier, motion)
    return y_m, v_m_s, rows[0].impacts


def classify(
    carrier: Carrier, starts: NDArray[np.float64], protocol: Protocol
) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Return the regimes (−1 − regime if uncertain) and the impacts per period of starts.

    `starts`: (y, v, crank angle), shape (n, 3).
    """
    regimes, impacts = np.empty(len(starts), np.int8), np.empty(len(starts), np.float32)
    rows, streaks = sections.new_rows(protocol, carrier.size.drive_rad_s)
    arguments = carrier, starts, protocol, rows, streaks, regimes, impacts
    entry_point(sections.classify_starts, *arguments)(*arguments)
    return regimes, impacts


def carrier_of(scene: Scene, accuracy_m: float = ACCURACY_M) -> Carrier:
    """The carrier of a scene with an ideal drive; `accuracy_m` is the adaptive solver's per period."""
    parts = scene.parts()
    if not scene.beyond_closed_form:
        return closed(parts)
    rest = MotionState(0.0, scene.striker.rest_length_m, 0.0, 0.0, 0.0, Phase.FLIGHT)
    return stepwise(parts, allocate(parts, rest, accuracy_m, IMPACTS_AT_ONCE))
