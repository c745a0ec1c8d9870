"""Orbits of a case, by the closed-form solution if there is one, otherwise by the adaptive solver."""

import time
from collections.abc import Iterable
from functools import lru_cache
from threading import local
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.orbits import adaptive as adaptive_orbits
from plant_sim.orbits import exact as exact_orbits
from plant_sim.orbits.sections import CLASSIFY, Outcome, Protocol
from plant_sim.result import MotionState, Phase
from plant_sim.solvers.adaptive.state_layout import Memory, allocate
from tools.study.cases import Case

ACCURACY_M = 1e-7
"""Accuracy of the adaptive solver per period, m: about a millionth of the gap."""

IMPACTS_AT_ONCE = 256

_own = local()


class State(NamedTuple):
    """State of the module: position less rest length, velocity, crank angle."""

    y_m: float
    v_m_s: float
    crank_rad: float


AT_REST = State(0.0, 0.0, 0.0)


def follow(case: Case, ratio: float, start: State, protocol: Protocol) -> Outcome:
    """Return the outcome of one start."""
    if case.is_exact:
        return exact_orbits.follow(
            case.striker(), case.drive(ratio), case.closed_friction(), case.rigid_stop(), *start, protocol
        )
    return adaptive_orbits.follow_stepwise(case.parts(ratio), _memory(case), *start, protocol)


def warm(cases: Iterable[Case]) -> float:
    """Compile or load the kernels of these cases, one after the other; return the elapsed time in s."""
    started_s = time.perf_counter()
    at_once = CLASSIFY._replace(settle_s=0.0)
    for kernel in {
        (case.is_exact, case.law if case.is_exact else "", case.contact_s is None): case for case in cases
    }.values():
        follow(kernel, 1.0, AT_REST, at_once)
    return time.perf_counter() - started_s


def classify(
    case: Case, ratio: float, starts: NDArray[np.float64], protocol: Protocol
) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Return the regimes (−1 − regime if uncertain) and the impacts per period of starts.

    `starts`: (y, v, crank angle), shape (n, 3).
    """
    regimes, impacts = np.empty(len(starts), np.int8), np.empty(len(starts), np.float32)
    if case.is_exact:
        exact_orbits.classify(
            case.striker(),
            case.drive(ratio),
            case.closed_friction(),
            case.rigid_stop(),
            starts,
            protocol,
            regimes,
            impacts,
        )
    else:
        adaptive_orbits.classify_stepwise(
            case.parts(ratio), _memory(case), starts, protocol, regimes, impacts
        )
    return regimes, impacts


def _memory(case: Case) -> Memory:
    """Return the solver memory of this thread for the case."""
    if not hasattr(_own, "memories"):
        _own.memories = lru_cache(maxsize=64)(_allocate)
    memory: Memory = _own.memories(case)
    return memory


def _allocate(case: Case) -> Memory:
    rest = MotionState(0.0, case.rest_length_m, 0.0, 0.0, 0.0, Phase.FLIGHT)
    return allocate(case.parts(1.0), rest, ACCURACY_M, IMPACTS_AT_ONCE)
