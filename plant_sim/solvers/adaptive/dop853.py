"""One step of DOP853, its error and its continuous extension, for the equations of `motion`.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, sections II.5, 6 and 10.
"""

import math

from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.solvers.adaptive.bernstein import DEGREE
from plant_sim.solvers.adaptive.dop853_tables import E3, E5, A, C, D
from plant_sim.solvers.adaptive.motion import derivative
from plant_sim.solvers.adaptive.state_layout import STAGES, Flow, Vector, state_size, work_place


@subroutine
def attempt(
    parts: Parts, flow: Flow, h_s: float, y: Vector, scale: Vector, k: Vector, trial: Vector, new: Vector
) -> float:
    """Step from `y` to `new`; returns the error, 1 at the tolerance `scale`. `k[0]` is the derivative at `y`.

    `k` has shape (STAGES, n), all others (n,).
    """
    n, motion = state_size(parts), work_place(parts)
    for stage in range(1, 12):
        for i in range(motion):  # the integrals feed back into nothing
            trial[i] = y[i] + h_s * _slope(k, stage, 1 if stage < 5 else 3, i)
        derivative(parts, flow, C[stage] * h_s, trial, k[stage])
    fifth, third = 0.0, 0.0
    for i in range(n):
        new[i] = y[i] + h_s * _slope(k, 12, 5, i)
        e5 = E5[0] * k[0, i]
        e3 = E3[0] * k[0, i]
        for j in range(5, 12):
            e5 += E5[j] * k[j, i]
            e3 += E3[j] * k[j, i]
        fifth += (e5 / scale[i]) ** 2
        third += (e3 / scale[i]) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h_s) * fifth / math.sqrt((fifth + 0.01 * third) * n)


@subroutine
def _slope(k: Vector, stage: int, first: int, i: int) -> float:
    """Σ a_j k_j of one quantity; the row of A holds zeros in columns 1 to `first` − 1."""
    total: float = A[stage, 0] * k[0, i]
    for j in range(first, stage):
        total += A[stage, j] * k[j, i]
    return total


@subroutine
def extend(
    parts: Parts, flow: Flow, h_s: float, y: Vector, new: Vector, k: Vector, trial: Vector, dense: Vector
) -> None:
    """Bernstein coefficients of the motion over the step, into `dense`, shape (motion, DEGREE + 1)."""
    motion = work_place(parts)
    derivative(parts, flow, h_s, new, k[12])
    for stage in range(13, STAGES):
        for i in range(motion):
            trial[i] = y[i] + h_s * _slope(k, stage, 5, i)
        derivative(parts, flow, C[stage] * h_s, trial, k[stage])
    for i in range(motion):
        b = dense[i]
        rise = new[i] - y[i]
        # y0 + s (F0 + (1 − s)(F1 + s (F2 + (1 − s)(F3 + s (F4 + (1 − s)(F5 + s F6))))))
        b[0] = _extension_term(h_s, k, 3, i)
        _times_s(b, 0)
        _add(b, 1, _extension_term(h_s, k, 2, i))
        _times_one_minus_s(b, 1)
        _add(b, 2, _extension_term(h_s, k, 1, i))
        _times_s(b, 2)
        _add(b, 3, _extension_term(h_s, k, 0, i))
        _times_one_minus_s(b, 3)
        _add(b, 4, 2.0 * rise - h_s * (k[12, i] + k[0, i]))
        _times_s(b, 4)
        _add(b, 5, h_s * k[0, i] - rise)
        _times_one_minus_s(b, 5)
        _add(b, 6, rise)
        _times_s(b, 6)
        _add(b, DEGREE, y[i])


@subroutine
def _extension_term(h_s: float, k: Vector, row: int, i: int) -> float:
    total: float = D[row, 0] * k[0, i]
    for j in range(5, STAGES):
        total += D[row, j] * k[j, i]
    return h_s * total


@subroutine
def _add(b: Vector, degree: int, constant: float) -> None:
    for j in range(degree + 1):
        b[j] += constant


@subroutine
def _times_s(b: Vector, degree: int) -> None:
    """s p(s), one degree higher: c_j = j b_(j−1) / (n + 1)."""
    for j in range(degree + 1, 0, -1):
        b[j] = j * b[j - 1] / (degree + 1)
    b[0] = 0.0


@subroutine
def _times_one_minus_s(b: Vector, degree: int) -> None:
    """(1 − s) p(s), one degree higher: c_j = (n + 1 − j) b_j / (n + 1)."""
    b[degree + 1] = 0.0
    for j in range(degree + 1):
        b[j] = (degree + 1 - j) * b[j] / (degree + 1)
