"""The result of a method for a case, and its error."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from tools.trade.cases import Case

LEAST_IMPACT_M_S = 1e-3
"""Slowest impact that is counted; chatter ends with infinitely many slower ones."""


class Answer(NamedTuple):
    """Result of a method: impacts of at least LEAST_IMPACT_M_S, and the state at the end."""

    t_s: FloatArray
    v_m_s: FloatArray
    v_after_m_s: FloatArray
    x_end_m: float
    v_end_m_s: float


def answer(t_s: FloatArray, v_m_s: FloatArray, v_after_m_s: FloatArray, x_m: float, end_m_s: float) -> Answer:
    """Return an answer without the impacts that are slower than LEAST_IMPACT_M_S."""
    counted = np.asarray(v_m_s) >= LEAST_IMPACT_M_S
    times, before, after = (np.asarray(a, dtype=np.float64)[counted] for a in (t_s, v_m_s, v_after_m_s))
    return Answer(times, before, after, float(x_m), float(end_m_s))


Solve = Callable[[], Answer]


class Method(NamedTuple):
    """A method with one setting; the time of `solve` is measured."""

    name: str
    setting: str
    solve: Solve


class Errors(NamedTuple):
    """Errors of an answer by their keys in a row; nan for single impacts if their number is wrong."""

    error: float
    """Error of the final state in m: of the position, or of the velocity over ω, whichever is larger."""
    impact_time_error_s: float
    impact_speed_error_m_s: float
    impulse_error: float
    """Relative error of the total momentum exchanged with the stop."""
    impacts: int
    impacts_wanted: int


def errors_of(case: Case, given: Answer, truth: Answer) -> Errors:
    """Compare an answer with the truth."""
    same = given.t_s.size == truth.t_s.size
    nan = math.nan
    exchanged = float(np.sum(truth.v_m_s - truth.v_after_m_s))
    difference = abs(float(np.sum(given.v_m_s - given.v_after_m_s)) - exchanged)
    return Errors(
        error=max(
            abs(given.x_end_m - truth.x_end_m),
            abs(given.v_end_m_s - truth.v_end_m_s) / case.scene.natural_rad_s,
        ),
        impact_time_error_s=_largest(given.t_s - truth.t_s) if same else nan,
        impact_speed_error_m_s=_largest(given.v_m_s - truth.v_m_s) if same else nan,
        impulse_error=difference / exchanged if exchanged > 0.0 else difference,
        impacts=given.t_s.size,
        impacts_wanted=truth.t_s.size,
    )


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values), initial=0.0))
